"""Checkpoints: the state of long work, so that a killed one goes on where it was.

They are read with torch's restricted loader, which knows tensors and plain values only: a file that
somebody else put there can bring nothing else to life.
"""

import io
import logging
from pathlib import Path
from typing import Any

import numpy as np
import torch
from upath import UPath

from tactile_core.checksums import sealed, unsealed
from tactile_core.files import kept_bytes, written_whole

logger = logging.getLogger(__name__)

ARRAY = "numpy array"  # the key of a dict that stands for one


def save_checkpoint(path: Path | UPath, key: str, state: dict[str, Any]) -> None:
    """Write `state` whole, under the `key` of all inputs and settings that it belongs to."""
    saved = io.BytesIO()
    torch.save({"key": key, "state": plain(state)}, saved)
    with written_whole(path) as file:
        file.write(sealed(saved.getvalue()))


def load_checkpoint(path: Path | UPath, key: str) -> dict[str, Any] | None:
    """The state at `path`; None where there is none, or it is damaged or of another key.

    Raises `OutOfReachError` where that cannot be told: else hours of work would start over.
    """
    try:
        data = kept_bytes(UPath(path))
    except OSError:  # there is none
        return None
    try:
        saved = torch.load(io.BytesIO(unsealed(data)), map_location="cpu", weights_only=True)
        found, state = saved["key"], restored(saved["state"])
    except MemoryError:  # it may be whole
        raise
    except Exception as error:  # a damaged file can bring about any other
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        logger.warning("%s cannot be read (%s): the work starts over", path, reason)
        return None
    return state if found == key else None


def plain(value: Any) -> Any:
    """`value` with arrays as tensors and numpy's numbers as Python's, through all containers."""
    if isinstance(value, dict):
        return {name: plain(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return type(value)(map(plain, value))
    if isinstance(value, np.ndarray):
        return {ARRAY: torch.from_numpy(np.array(value))}
    return value.item() if isinstance(value, np.generic) else value


def restored(value: Any) -> Any:
    """What `plain` was given."""
    if isinstance(value, dict):
        if set(value) == {ARRAY}:
            return value[ARRAY].numpy()
        return {name: restored(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return type(value)(map(restored, value))
    return value
