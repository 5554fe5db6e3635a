"""The best fixed sequence: ten rays, chosen one after the other, that are best on average."""

from collections.abc import Callable

import numpy as np
import pandas as pd

from tactile_core.dataset.shapes import Shapes
from tactile_core.exploration.learning.gains import find_gains
from tactile_core.exploration.world.rays import RAYS, candidate_rays
from tactile_core.exploration.world.state import Explorations
from tactile_core.reconstruction.inference import Reconstructor

SHAPES = 200  # train shapes that rays are tried on, drawn by the seed


def best_sequence(
    title: str,
    seed: int,
    train: Shapes,
    reconstructor: Reconstructor,
    progress: Callable[[str], None],
) -> tuple[np.ndarray, pd.DataFrame]:
    """Ten rays (RAYS, 2) int: each the candidate that, after those before it, adds most to the mean
    Jaccard index of train shapes.

    Where the U-Net sees free space, every candidate is not tried on every shape: its mean is over
    those where it was. Returns the rays with their curve, as `train_ppo` does: a row for each ray.
    """
    rng = np.random.default_rng(seed)
    some = rng.choice(len(train), min(SHAPES, len(train)), replace=False)
    candidates = candidate_rays(train.resolution).reshape(-1, 2)
    explorations = Explorations(train.packed[np.sort(some)], reconstructor)
    rays, rows = [], []
    for number in range(1, RAYS + 1):
        gains, known = find_gains(explorations, 2 * len(candidates), rng)  # (N, C) each
        tried = known.sum(axis=0)
        means = np.where(tried, (gains * known).sum(axis=0) / np.maximum(tried, 1), -np.inf)
        rays.append(candidates[means.argmax()])
        before = explorations.jaccard.mean()
        explorations.cast(np.tile(rays[-1], (len(explorations), 1)))
        jaccard = float(explorations.jaccard.mean())
        rows.append(
            {
                "stage": 0, "steps": number * len(explorations), "reward": jaccard - before,
                "jaccard": jaccard, "touches": float(explorations.held.mean()),
            }
        )  # fmt: skip
        progress(f"{title}: ray {number}/{RAYS}, Jaccard {jaccard:.1f}")
    return np.stack(rays), pd.DataFrame(rows)
