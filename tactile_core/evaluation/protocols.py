"""The report's two evaluations (section VII): per step, and per grasp."""

import zlib
from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np
import pandas as pd

from tactile_core.dataset.shapes import Shapes
from tactile_core.errors import TactileError
from tactile_core.evaluation.rollout import Rollout
from tactile_core.exploration.policies.base import Policy
from tactile_core.exploration.policies.references import find_reference
from tactile_core.exploration.world.rays import ray_ends
from tactile_core.exploration.world.state import Explorations
from tactile_core.reconstruction.inference import Reconstructor
from tactile_core.settings import EvaluationSettings

Progress = Callable[[str], None]


def evaluate_per_step(
    policies: Sequence[Policy],
    test: Shapes,
    reconstructor: Reconstructor,
    settings: EvaluationSettings,
    progress: Progress = lambda message: None,
) -> pd.DataFrame:
    """`settings.count` rays of each policy on every test sample (Figure 4).

    Rows: policy, seed, sample_id, model_id, category, step (from 1), jaccard (0–100),
    touches held, missed, repeated.
    """
    tables = []
    for policy in with_references(policies, settings):
        rng = policy_rng(policy, settings.seed)
        explorations = Explorations(test.masks, reconstructor)
        for step in range(1, settings.count + 1):
            cast = explorations.cast(policy.choose(explorations, rng, settings.deterministic))
            table = sample_columns(policy, test)
            table["step"] = step
            table["jaccard"] = cast.jaccard.astype(float)
            table["touches"] = explorations.held.copy()
            table["missed"] = cast.missed
            table["repeated"] = cast.repeated
            tables.append(table)
        progress(
            f"per step: {policy.name} (seed {policy.seed}) reaches Jaccard "
            f"{explorations.jaccard.mean():.1f} after {settings.count} rays"
        )
    return pd.concat(tables, ignore_index=True)


def evaluate_per_grasp(
    policies: Sequence[Policy],
    test: Shapes,
    reconstructor: Reconstructor,
    settings: EvaluationSettings,
    progress: Progress = lambda message: None,
) -> pd.DataFrame:
    """Rays of each policy until `settings.count` touches are held (Figure 5).

    Rows: policy, seed, sample_id, model_id, category, grasp (from 1), jaccard (0–100; null
    where `ray_limit` rays did not bring so many touches) and rays cast until then.
    """
    tables = []
    for policy in with_references(policies, settings):
        jaccard, rays = grasps_of(policy, test, reconstructor, settings)
        for grasp in range(1, settings.count + 1):
            table = sample_columns(policy, test)
            table["grasp"] = grasp
            table["jaccard"] = jaccard[:, grasp - 1]
            table["rays"] = rays[:, grasp - 1]
            tables.append(table)
        reached = ~np.isnan(jaccard[:, -1])
        final = f"{jaccard[reached, -1].mean():.1f}" if reached.any() else "–"
        progress(
            f"per grasp: {policy.name} (seed {policy.seed}) reaches Jaccard {final} with "
            f"{settings.count} touches in {rays[:, -1].mean():.1f} rays ({reached.mean():.0%})"
        )
    return pd.concat(tables, ignore_index=True)


def grasps_of(
    policy: Policy, test: Shapes, reconstructor: Reconstructor, settings: EvaluationSettings
) -> tuple[np.ndarray, np.ndarray]:
    """Jaccard index (N, count), NaN where not reached, and rays cast (N, count), int."""
    jaccard = np.full((len(test), settings.count), np.nan)
    rays = np.full((len(test), settings.count), settings.ray_limit)
    rng = policy_rng(policy, settings.seed)
    active = np.arange(len(test))
    explorations = Explorations(test.masks, reconstructor)
    for ray in range(1, settings.ray_limit + 1):
        cast = explorations.cast(policy.choose(explorations, rng, settings.deterministic))
        gained = ~cast.missed & ~cast.repeated
        grasp = explorations.held[gained] - 1
        jaccard[active[gained], grasp] = cast.jaccard[gained]
        rays[active[gained], grasp] = ray
        unfinished = np.flatnonzero(explorations.held < settings.count)
        if len(unfinished) == 0:
            break
        if len(unfinished) < len(explorations):
            active, explorations = active[unfinished], explorations.select(unfinished)
    return jaccard, rays


def record_rollout(
    policy: Policy,
    test: Shapes,
    index: int,
    reconstructor: Reconstructor,
    settings: EvaluationSettings,
) -> Rollout:
    """A rollout of `settings.count` rays on test sample `index`, to draw (Figures 2 and 3)."""
    rng = policy_rng(policy, settings.seed)
    explorations = Explorations(test.masks[index : index + 1], reconstructor)
    rays, touches, predictions, jaccard = [], [], [], []
    for _ in range(settings.count):
        ray = policy.choose(explorations, rng, settings.deterministic)
        cast = explorations.cast(ray)
        rays.append(ray_ends(ray, test.resolution)[0])
        touches.append(cast.touches[0])
        predictions.append(explorations.predictions[0].copy())
        jaccard.append(float(cast.jaccard[0]))
    return Rollout(
        policy=policy.name,
        mask=test.masks[index],
        rays=np.array(rays),
        touches=np.array(touches),
        predictions=np.array(predictions),
        jaccard=np.array(jaccard),
    )


def with_references(policies: Sequence[Policy], settings: EvaluationSettings) -> list[Policy]:
    """The reference policies that `settings` name, then the trained ones.

    Raises `TactileError` where two have one name and seed: no table could tell them apart.
    """
    every = [*map(find_reference, settings.references), *policies]
    twice = [who for who, n in Counter((one.name, one.seed) for one in every).items() if n > 1]
    if twice:
        name, seed = twice[0]
        raise TactileError(f"two policies are called {name!r} with seed {seed}: rename an approach")
    return every


def policy_rng(policy: Policy, seed: int) -> np.random.Generator:
    """A generator of the policy's own: adding a policy does not change the others' rows."""
    return np.random.default_rng([seed, policy.seed, zlib.crc32(policy.name.encode())])


def sample_columns(policy: Policy, test: Shapes) -> pd.DataFrame:
    """The columns that say whose row it is, one row for each test sample."""
    return pd.DataFrame(
        {
            "policy": policy.name,
            "seed": policy.seed,
            "sample_id": test.sample_ids,
            "model_id": test.model_ids,
            "category": test.categories,
        }
    )
