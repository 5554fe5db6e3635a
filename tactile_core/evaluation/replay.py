"""One rollout, cast once more for drawing."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from tactile_core.dataset.shapes import Shapes
from tactile_core.exploration.world.rays import ray_ends
from tactile_core.exploration.world.state import Explorations
from tactile_core.reconstruction.inference import Reconstructor


@dataclass(frozen=True)
class Rollout:
    """T rays that one policy casts at one shape, and what was predicted after each.

    policy : name of the policy
    mask : (R, R) bool, the true shape
    rays : (T, 4) int16, each (row, column) of alpha, then (row, column) of beta
    touches : (T, 2) int16, (row, column) of each ray's touch; (-1, -1) for a miss
    predictions : (T, R, R) float32, probability of the shape after each ray, 0 to 1
    jaccard : (T,) float, Jaccard index after each ray, 0 to 100
    category : class of the object; empty where it has none
    """

    policy: str
    mask: np.ndarray
    rays: np.ndarray
    touches: np.ndarray
    predictions: np.ndarray
    jaccard: np.ndarray
    category: str = ""


def replayed(rows: pd.DataFrame, test: Shapes, index: int, reconstructor: Reconstructor) -> Rollout:
    """The rays of one policy at test sample `index`, cast once more to draw (Figures 2 and 3).

    rows : of the table of rollouts, in the order of the rays
    """
    explorations = Explorations(test.masks[index : index + 1], reconstructor)
    rays = rows[["alpha", "beta"]].to_numpy()  # (T, 2)
    touches, predictions, jaccard = [], [], []
    for ray in rays:
        cast = explorations.cast(ray[None])
        touches.append(cast.touches[0])
        predictions.append(explorations.predictions[0].copy())
        jaccard.append(float(cast.jaccard[0]))
    return Rollout(
        policy=str(rows["policy"].iloc[0]),
        mask=test.masks[index],
        rays=ray_ends(rays, test.resolution),
        touches=np.array(touches),
        predictions=np.array(predictions),
        jaccard=np.array(jaccard),
        category=str(test.categories[index]),
    )
