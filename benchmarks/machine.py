"""What a run was measured on: figures without their machine say nothing."""

import datetime
import os
import platform
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any

import torch

from tactile_core.dataset.rendering.opengl import working_platform
from tactile_core.machine import commit, memory_gib, processor
from tactile_core.reconstruction.inference import best_device, bfloat16_pays

REPOSITORY = Path(__file__).resolve().parents[1]
LIBRARIES = ("torch", "numpy", "numba", "stable-baselines3", "pyrender2")


def describe_machine(seconds: float) -> dict[str, Any]:
    """The machine, the versions, and this run, which took so many seconds."""
    cuda = torch.cuda.is_available()
    return {
        "cpu": processor(),
        "cores": len(os.sched_getaffinity(0)),
        "memory_gib": memory_gib(),
        "gpu": torch.cuda.get_device_name() if cuda else None,
        "system": platform.platform(),
        "opengl": working_platform(),
        "bfloat16_pays": bfloat16_pays(best_device().type),
        "torch_threads": torch.get_num_threads(),
        "load_at_end": round(os.getloadavg()[0], 1),
        "python": platform.python_version(),
        **{name: version(name) for name in LIBRARIES},
        "commit": commit(REPOSITORY),
        "date": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "command": " ".join([f"python -m benchmarks.{Path(sys.argv[0]).stem}", *sys.argv[1:]]),
        "seconds": round(seconds),
    }
