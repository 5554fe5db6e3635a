"""A policy of one's own in the tables: its rays on a run's test samples, beside the stored ones."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from upath import UPath

from tactile_core.dataset.shapes import Shapes, load_shapes
from tactile_core.errors import TactileError
from tactile_core.evaluation.of_each_unet import cast_with_each
from tactile_core.evaluation.readings import per_grasp_reading, per_step_reading
from tactile_core.evaluation.statistics import FIRST, LAST
from tactile_core.evaluation.tables import PolicyResults, policy_results
from tactile_core.evaluation.unseen import refuse_known
from tactile_core.exploration.policies.own import FunctionPolicy, SB3Policy
from tactile_core.exploration.world.state import Explorations
from tactile_core.parquet import read_table
from tactile_core.profiles import Profile
from tactile_core.reconstruction.inference import Reconstructor
from tactile_core.reconstruction.unets import UNets, first_of, load_unets
from tactile_core.settings import EvaluationSettings, RolloutSettings


@dataclass(frozen=True)
class StoredRun:
    """What a run left to evaluate on: its test shapes, its U-Nets, the rollouts of its policies."""

    test: Shapes
    unets: UNets
    rollouts: pd.DataFrame


def stored_run(artifacts: UPath) -> StoredRun:
    """Read what the assets stored in `artifacts`.

    Raises `TactileError` where something is missing, where the U-Net was trained on a test model,
    or where the rollouts are on other shapes or of another U-Net.
    """
    if not (artifacts / "rollouts.parquet").exists():
        raise TactileError(
            f"no run has left rollouts in {artifacts}: dagster asset materialize --select "
            "'*rollouts' makes them and all that they need"
        )
    splits, outlines, rollouts = (
        read_table(artifacts / f"{name}.parquet")
        for name in ("rotated_splits", "outlines", "rollouts")
    )
    run = StoredRun(load_shapes(splits, outlines, "test"), load_unets(artifacts / "unet"), rollouts)
    remedy = "the splits have been dealt anew since, materialise unet again"
    seen = {"the U-Net": first_of(run.unets).trained_on}
    refuse_known(run.test, seen, by_name=True, remedy=remedy)
    if not repeats(run):
        raise TactileError(
            "rollouts are on other shapes or of another U-Net than those that are stored: "
            "materialise policies and rollouts again"
        )
    return run


def repeats(run: StoredRun) -> bool:
    """Whether a first ray on each shape, cast once more, comes to what the rollouts say.

    The Jaccard index may differ by the rounding of a few pixels.
    """
    first = run.rollouts[run.rollouts["ray"] == 1].drop_duplicates("sample_id")
    if list(first["sample_id"]) != list(run.test.sample_ids):
        return False
    explorations = Explorations(run.test.masks, Reconstructor(first_of(run.unets)))
    cast = explorations.cast(first[["alpha", "beta"]].to_numpy())
    there = np.array_equal(cast.touches, first[["row", "column"]])
    return there and float(np.abs(cast.jaccard - first["jaccard"]).mean()) < 1


def results_beside(
    policy: FunctionPolicy | SB3Policy,
    run: StoredRun,
    profile: Profile,
    progress: Callable[[str], None] = lambda message: None,
) -> tuple[PolicyResults, PolicyResults]:
    """Per step and per grasp, what the run's policies and this one come to on the same samples.

    With each of the run's U-Nets it counts as a policy of that one's seed. Its rays are cast as far
    as those of the run. Raises `TactileError` where the run has a policy of that name, or tables
    take every one of that name for a rule, an approach of the report or what can be attained.
    """
    if policy.name in set(run.rollouts["policy"]):
        raise TactileError(f"the run has a policy called {policy.name!r}: give yours another name")
    if policy.name in {*FIRST, *LAST}:
        raise TactileError(
            f"{policy.name!r} stands for another policy in every table: give yours another name"
        )
    per_step, per_grasp = profile.per_step, profile.per_grasp
    settings = profile.rollouts.model_copy(
        update={
            "references": [],
            "choices": sorted({per_step.choice, per_grasp.choice}),
            "count": max(per_step.count, per_grasp.count),
            "ray_limit": limit_of(run.rollouts, per_grasp, profile.rollouts),
        }
    )
    of_each = {seed: [replace(policy, seed=seed)] for seed in run.unets}
    own = cast_with_each(of_each, run.test, run.unets, settings, progress=progress)
    every = pd.concat([run.rollouts, own], ignore_index=True)
    steps, grasps = per_step_reading(every, per_step), per_grasp_reading(every, per_grasp)
    return (
        policy_results(steps, "step", per_step.resamples, per_step.seed),
        policy_results(grasps, "grasp", per_grasp.resamples, per_grasp.seed),
    )


def limit_of(rollouts: pd.DataFrame, read: EvaluationSettings, settings: RolloutSettings) -> int:
    """The ray limit that stored rollouts ended at, or that of `settings` where none of them did."""
    last = rollouts.groupby(["policy", "seed", "choice", "sample_id"])[["ray", "touches"]].max()
    ended = last.loc[last["touches"] < read.count, "ray"]
    return int(ended.max()) if len(ended) else settings.ray_limit
