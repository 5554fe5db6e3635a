"""One rollout as a whole, for drawing: cast once more, or for the first time."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from tactile_core.dataset.shapes import Shapes
from tactile_core.evaluation.casting import policy_rng
from tactile_core.exploration.policies.base import Policy
from tactile_core.exploration.world.rays import ray_ends
from tactile_core.exploration.world.state import Cast, Explorations
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
    rays = iter(rows[["alpha", "beta"]].to_numpy())  # (T, 2)
    name = str(rows["policy"].iloc[0])
    rollout = watched(
        name, test.packed[index], reconstructor, lambda _: next(rays)[None], len(rows)
    )
    return replace(rollout, category=str(test.categories[index]))


def feel_out(
    policy: Policy,
    mask: np.ndarray,
    reconstructor: Reconstructor,
    count: int,
    seed: int,
    progress: Callable[[int, Cast], None] = lambda ray, cast: None,
) -> Rollout:
    """`count` rays of a policy at one mask (R, R); `progress` hears of each as it is cast."""
    rng = policy_rng(policy, seed)
    return watched(
        policy.name, mask, reconstructor, lambda state: policy.choose(state, rng, False), count,
        progress,
    )  # fmt: skip


def watched(
    policy: str,
    mask: np.ndarray,
    reconstructor: Reconstructor,
    choose: Callable[[Explorations], np.ndarray],
    count: int,
    progress: Callable[[int, Cast], None] = lambda ray, cast: None,
) -> Rollout:
    """`count` rays at a mask (R, R), each as `choose` has it, (1, 2) int, and what came of it."""
    explorations = Explorations(mask[None], reconstructor)
    rays, touches, predictions, jaccard = [], [], [], []
    for ray in range(1, count + 1):
        rays.append(choose(explorations)[0])
        cast = explorations.cast(rays[-1][None])
        touches.append(cast.touches[0])
        predictions.append(explorations.predictions[0].copy())
        jaccard.append(float(cast.jaccard[0]))
        progress(ray, cast)
    return Rollout(
        policy=policy,
        mask=mask,
        rays=ray_ends(np.array(rays), len(mask)),
        touches=np.array(touches),
        predictions=np.array(predictions),
        jaccard=np.array(jaccard),
    )
