"""The best fixed sequence: ten rays, chosen one after the other, that are best on average."""

from collections.abc import Callable

import numpy as np
import pandas as pd

from tactile_core.dataset.shapes import Shapes
from tactile_core.exploration.learning.gains import find_gains
from tactile_core.exploration.world.rays import RAYS, candidate_rays
from tactile_core.exploration.world.state import Explorations
from tactile_core.progress import teller
from tactile_core.reconstruction.inference import Reconstructor

SHAPES = 200  # train shapes that rays are tried on, drawn by the seed
AT_ONCE = 20  # shapes between two looks at the clock


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
    parts = np.array_split(np.sort(some), -(-len(some) // AT_ONCE))
    explorations = [Explorations(train.packed[part], reconstructor) for part in parts]
    tell = teller(progress, RAYS * len(parts))
    before = mean_of([part.jaccard for part in explorations])
    rays, rows = [], []
    for number in range(1, RAYS + 1):
        gained, tried = np.zeros(len(candidates)), np.zeros(len(candidates), int)
        for done, part in enumerate(explorations, start=1):
            gains, known = find_gains(part, 2 * len(candidates), rng)  # (n, C) each
            gained += (gains * known).sum(axis=0)
            tried += known.sum(axis=0)
            words = f"{title}: ray {number}/{RAYS} tried on {done} of {len(parts)} parts"
            tell((number - 1) * len(parts) + done, words)
        means = np.where(tried, gained / np.maximum(tried, 1), -np.inf)
        rays.append(candidates[means.argmax()])
        for part in explorations:
            part.cast(np.tile(rays[-1], (len(part), 1)))
        jaccard = mean_of([part.jaccard for part in explorations])
        rows.append(
            {
                "stage": 0, "steps": number * len(some), "reward": jaccard - before,
                "jaccard": jaccard, "touches": mean_of([part.held for part in explorations]),
            }
        )  # fmt: skip
        before = jaccard
        progress(f"{title}: ray {number}/{RAYS}, Jaccard {jaccard:.1f}")
    return np.stack(rays), pd.DataFrame(rows)


def mean_of(parts: list[np.ndarray]) -> float:
    return float(np.concatenate(parts).mean())
