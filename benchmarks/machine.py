"""What a run was measured on: figures without their machine say nothing."""

import datetime
import os
import platform
import re
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any

import torch

from tactile_core.dataset.opengl import working_platform
from tactile_core.reconstruction.inference import best_device, bfloat16_pays

REPOSITORY = Path(__file__).resolve().parents[1]
LIBRARIES = ("torch", "numpy", "numba", "stable-baselines3", "pyrender2")


def describe_machine(seconds: float) -> dict[str, Any]:
    """The machine, the versions, and this run, which took so many seconds."""
    cuda = torch.cuda.is_available()
    return {
        "cpu": processor(),
        "cores": len(os.sched_getaffinity(0)),
        "memory_gb": round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30, 1),
        "gpu": torch.cuda.get_device_name() if cuda else None,
        "system": platform.platform(),
        "opengl": working_platform(),
        "bfloat16_pays": bfloat16_pays(best_device().type),
        "torch_threads": torch.get_num_threads(),
        "load_at_end": round(os.getloadavg()[0], 1),
        "python": platform.python_version(),
        **{name: version(name) for name in LIBRARIES},
        "commit": commit(),
        "date": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "command": " ".join(["python -m benchmarks.bench", *sys.argv[1:]]),
        "seconds": round(seconds),
    }


def processor() -> str:
    """The processor's name, with family and model, since virtual machines often hide the name."""
    cpuinfo = Path("/proc/cpuinfo")
    if not cpuinfo.exists():
        return platform.processor() or platform.machine()
    fields = dict(
        re.findall(r"^(model name|cpu family|model)\s*: (.*)$", cpuinfo.read_text(), re.M)
    )
    if "model name" not in fields:
        return platform.machine()
    return f"{fields['model name']} (family {fields['cpu family']}, model {fields['model']})"


def commit() -> str | None:
    """The commit of the checkout, marked where files differ from it; None outside of one."""
    command = ["git", "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"]
    result = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, check=False)
    return result.stdout.strip() or None
