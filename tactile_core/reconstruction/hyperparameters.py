"""What a search found, for the trainings that follow it.

Apart from the search itself: how trials are run is no part of what a training depends on.
"""

from typing import TypeVar

import pandas as pd

from tactile_core.errors import TactileError
from tactile_core.settings import NetSettings

AnyNetSettings = TypeVar("AnyNetSettings", bound=NetSettings)


def with_best_trial(settings: AnyNetSettings, search: pd.DataFrame) -> AnyNetSettings:
    """`settings` with every empty hyperparameter taken from the trial with the lowest loss."""
    best = search.loc[search["loss"].idxmin()]
    found = {
        "learning_rate": float(best["learning_rate"]),
        "batch_size": int(best["batch_size"]),
        "depth": int(best["depth"]),
        "channels": int(best["channels"]),
    }
    empty = {name: value for name, value in found.items() if getattr(settings, name) is None}
    return settings.model_copy(update=empty)


def required(settings: NetSettings) -> tuple[float, int, int, int]:
    """Learning rate, batch size, depth and channels; `TactileError` where one is empty."""
    values = settings.learning_rate, settings.batch_size, settings.depth, settings.channels
    if None in values:
        raise TactileError(
            "U-Net settings lack learning_rate, batch_size, depth or channels: give them, or "
            "materialise unet_search and take its best trial"
        )
    return values  # type: ignore[return-value]
