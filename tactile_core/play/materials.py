"""What the game is played with: the U-Net, who may play against you, shapes of the test split."""

import contextlib
import copy
from dataclasses import dataclass

import numpy as np

from tactile_core.dataset.rendering.pictures import decode_masks
from tactile_core.errors import TactileError
from tactile_core.exploration.acting import find_policy
from tactile_core.exploration.at_hand import POLICIES, ROTATED_SPLITS, UNET, at_hand
from tactile_core.exploration.policies.base import Policy
from tactile_core.parquet import read_table
from tactile_core.reconstruction.inference import Reconstructor
from tactile_core.reconstruction.trained import load_unet

# Who they are, in words for somebody who has not read of them.
OPPONENTS = {
    "recall": "tries promising rays on shapes it knows that agree with what it felt",
    "even": "sweeps around the middle, whatever it feels",
    "oracle": "knows the shape, and casts the ray that helps most at once",
}


@dataclass(frozen=True)
class Materials:
    """For all players of a server; nothing here changes.

    reconstructor, thinker : the U-Net for players' rays and for the opponents', each for one
        thread
    opponents : policies by name; shapes : masks (n, R, R) bool of the test split by class
    """

    reconstructor: Reconstructor
    thinker: Reconstructor
    opponents: dict[str, Policy]
    shapes: dict[str, np.ndarray]

    @property
    def resolution(self) -> int:
        return self.reconstructor.resolution


def gather() -> Materials:
    """From the home's run or, where none has got so far, from what the package ships."""
    artifacts = at_hand(ROTATED_SPLITS, UNET, POLICIES)
    reconstructor = Reconstructor(load_unet(artifacts / "unet"))
    # What the first ray would have to wait for.
    _ = reconstructor.untouched
    if not reconstructor.free_space:
        _ = reconstructor.single_touches
    table = read_table(artifacts / ROTATED_SPLITS)
    test = table[table["split"] == "test"]
    if test.empty:
        raise TactileError(f"{artifacts} has no shapes in the test split to hide: make another run")
    return Materials(
        reconstructor,
        copy.copy(reconstructor),  # which compiles for itself
        opponents(reconstructor),
        {str(name): decode_masks(rows["mask"]) for name, rows in test.groupby("category")},
    )


def opponents(reconstructor: Reconstructor) -> dict[str, Policy]:
    """Those of `OPPONENTS` that are there: not every run trains what `recall` needs."""
    found = {}
    for name in OPPONENTS:
        with contextlib.suppress(TactileError):
            found[name] = find_policy(name, reconstructor)
    return found
