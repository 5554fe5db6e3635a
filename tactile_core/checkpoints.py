"""Checkpoints: the state of long work, so that a killed one goes on where it was."""

import logging
from pathlib import Path
from typing import Any

import torch

from tactile_core.files import written_whole

logger = logging.getLogger(__name__)


def save_checkpoint(path: Path, key: str, state: dict[str, Any]) -> None:
    """Write `state` whole, under the `key` of all inputs and settings that it belongs to."""
    with written_whole(path) as file:
        torch.save({"key": key, "state": state}, file)


def load_checkpoint(path: Path, key: str) -> dict[str, Any] | None:
    """The state at `path`; None where there is none, or it is damaged or of another key."""
    if not path.exists():
        return None
    try:
        # Ours alone: arrays and generator states, which torch's restricted loader refuses.
        saved = torch.load(path, map_location="cpu", weights_only=False)
        found, state = saved["key"], saved["state"]
    except Exception as error:  # a damaged pickle can bring about any
        logger.warning("%s cannot be read (%s): the work starts over", path, error)
        return None
    return state if found == key else None
