"""One rollout, recorded for drawing."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Rollout:
    """T rays that one policy casts at one shape, and what was predicted after each.

    policy : name of the policy
    mask : (R, R) bool, the true shape
    rays : (T, 4) int16, each (row, column) of alpha, then (row, column) of beta
    touches : (T, 2) int16, (row, column) of each ray's touch; (-1, -1) for a miss
    predictions : (T, R, R) float32, probability of the shape after each ray, 0 to 1
    jaccard : (T,) float, Jaccard index after each ray, 0 to 100
    """

    policy: str
    mask: np.ndarray
    rays: np.ndarray
    touches: np.ndarray
    predictions: np.ndarray
    jaccard: np.ndarray
