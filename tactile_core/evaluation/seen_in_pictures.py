"""What the report sees in its pictures (section VII, Figures 2 and 3), as numbers."""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from tactile_core.dataset.shapes import Shapes
from tactile_core.dataset.touches import rasterise_touches
from tactile_core.exploration.world.circle import circle_pixels, middle
from tactile_core.exploration.world.rays import RAYS
from tactile_core.reconstruction.inference import Reconstructor
from tactile_core.reconstruction.jaccard import jaccard_index

# How much the starts of rays have in common where they are spread evenly over half of the circle.
HALF_CIRCLE = 2 / np.pi


def told_by_radius(prediction: np.ndarray) -> float:
    """Share of the variance of a prediction (R, R) that the distance from the middle tells; 0 where
    it is the same everywhere."""
    rows, columns = np.indices(prediction.shape) - middle(len(prediction))
    ring = np.hypot(rows, columns).round().astype(int)
    means = np.bincount(ring.ravel(), prediction.ravel()) / np.bincount(ring.ravel())
    rest = float(np.var(prediction - means[ring]))
    whole = float(np.var(prediction))
    return 1 - rest / whole if whole > 1e-12 else 0.0


def other_half(test: Shapes, reconstructor: Reconstructor, seed: int = 0) -> tuple[float, float]:
    """Mean Jaccard index of the right halves of all test shapes, before any touch and after RAYS
    touches on the outlines' left halves."""
    rng, centre = np.random.default_rng(seed), middle(test.resolution)
    touches = []
    for outline in test.outlines:
        left = outline[outline[:, 1] <= centre]
        chosen = rng.choice(len(left), min(RAYS, len(left)), replace=False)
        touches.append(left[chosen])
    right = np.s_[..., centre + 1 :]
    masks = test.masks[right]
    untouched = np.broadcast_to(reconstructor.untouched[right], masks.shape)
    predictions = reconstructor.predict(rasterise_touches(touches, test.resolution))[right]
    return (
        float(jaccard_index(untouched, masks).mean()),
        float(jaccard_index(predictions, masks).mean()),
    )


def in_common(rollouts: pd.DataFrame, resolution: int) -> Mapping[str, float]:
    """How much the starts of ten rays have in common, 0 to 1, by policy: the length of the mean of
    their directions from the middle, over all rollouts."""
    ten = rollouts[rollouts["ray"] <= RAYS]
    across, down = (circle_pixels(resolution) - middle(resolution)).T[::-1].astype(float)
    angles = np.arctan2(down, across)[ten["alpha"].to_numpy()]
    parts = ten[["policy", "seed", "sample_id"]].assign(x=np.cos(angles), y=np.sin(angles))
    mean = parts.groupby(["policy", "seed", "sample_id"])[["x", "y"]].mean()
    return np.hypot(mean["x"], mean["y"]).groupby(level="policy").mean().to_dict()
