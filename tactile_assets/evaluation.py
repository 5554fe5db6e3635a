"""Report, section VII: the policies on shapes that nothing was trained on."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import dagster as dg
import pandas as pd
from upath import UPath

from tactile_assets.automation import after
from tactile_assets.code_versions import code_version
from tactile_assets.config import PROFILE, StageConfig, defaults
from tactile_assets.io_managers import TrainedUNet
from tactile_assets.metadata import markdown, stored, wing
from tactile_assets.provenance import made_with
from tactile_assets.resources import Store
from tactile_core.settings import EvaluationSettings

if TYPE_CHECKING:
    from tactile_core.dataset.shapes import Shapes
    from tactile_core.evaluation.rollout import Rollout


@defaults(PROFILE.per_step)
class PerStepConfig(StageConfig, EvaluationSettings):
    """Ten rays of each policy on every test sample."""


@defaults(PROFILE.per_grasp)
class PerGraspConfig(StageConfig, EvaluationSettings):
    """Rays of each policy on every test sample until ten touches are held."""


EVALUATION: dict[str, Any] = {
    "kinds": {"pytorch", "matplotlib", "parquet"},
    **wing("evaluation"),
}
# What helps where a test model was trained on: in the test split, and among real meshes.
REMEDY = {
    False: "the splits have been dealt anew since, materialise unet and policies again",
    True: "TACTILE_REAL must name other meshes than those of the data set",
}
TRAINED = ("unet", "policies")  # an evaluation is made anew where one of these is new
CODE = "evaluation.protocols", "evaluation.unseen", "exploration.policies.store"
PER_STEP = code_version(*CODE, PROFILE.per_step)
PER_GRASP = code_version(*CODE, PROFILE.per_grasp)


@dg.asset(code_version=PER_STEP, automation_condition=after(*TRAINED), **EVALUATION)
def per_step_evaluation(
    context: dg.AssetExecutionContext,
    config: PerStepConfig,
    store: Store,
    rotated_splits: pd.DataFrame,
    outlines: pd.DataFrame,
    unet: TrainedUNet,
    policies: list[UPath],
) -> dg.MaterializeResult:
    """Ten rays of every policy on every test sample: the Jaccard index after each (Figure 4).

    Reference policies stand beside the trained ones: `random`, as in the report; `even`, a fixed
    sweep; `coverage` and `uncertainty`, which look at the reconstruction; and `oracle`, which
    knows the shape and takes the best ray there is. `recall` tries the best rays of `gain` on
    train shapes that agree with what was felt.
    """
    from tactile_core.dataset.shapes import load_shapes

    test = load_shapes(rotated_splits, outlines, "test")
    return per_step(test, unet, policies, config, store, context.log.info)


@dg.asset(code_version=PER_GRASP, automation_condition=after(*TRAINED), **EVALUATION)
def per_grasp_evaluation(
    context: dg.AssetExecutionContext,
    config: PerGraspConfig,
    store: Store,
    rotated_splits: pd.DataFrame,
    outlines: pd.DataFrame,
    unet: TrainedUNet,
    policies: list[UPath],
) -> dg.MaterializeResult:
    """Rays of every policy until ten touches are held: the Jaccard index at each (Figure 5).

    It tells whether a policy chooses better touches, or only misses less often. How many rays
    it took is in the table too. Where the ray limit was reached first, a touch that was never
    made is a row without a Jaccard index.
    """
    from tactile_core.dataset.shapes import load_shapes

    test = load_shapes(rotated_splits, outlines, "test")
    return per_grasp(test, unet, policies, config, store, context.log.info)


def per_step(
    test: "Shapes",
    unet: TrainedUNet,
    policies: list[UPath],
    config: PerStepConfig,
    store: Store,
    progress: Callable[[str], None],
    prefix: str = "",
) -> dg.MaterializeResult:
    """Figure 4's table on any shapes, with its figures under names that begin with `prefix`."""
    from tactile_core.evaluation.protocols import evaluate_per_step
    from tactile_core.evaluation.unseen import refuse_known
    from tactile_core.exploration.policies.store import load_policies
    from tactile_core.figures.animation import rollout_gif
    from tactile_core.figures.rollouts import runs_figure, steps_figure
    from tactile_core.figures.style import png
    from tactile_core.reconstruction.inference import Reconstructor

    refuse_known(test, seen_by(unet, policies), by_name=not prefix, remedy=REMEDY[bool(prefix)])
    trained = load_policies(policies, unet.version(), unet.resolution)
    reconstructor = Reconstructor(unet)
    table = evaluate_per_step(trained, test, reconstructor, config, progress)
    runs = example_runs(table, trained, test, reconstructor, config)
    return stored(
        table,
        **curve(table, "step", config, store, prefix),
        one_run=store.picture(f"{prefix}figure_2.png", png(steps_figure(runs[-1]))),
        runs=store.picture(f"{prefix}figure_3.png", png(runs_figure(runs), width_px=540)),
        animation=store.picture(f"{prefix}run.gif", rollout_gif(runs[-1])),
    )


def per_grasp(
    test: "Shapes",
    unet: TrainedUNet,
    policies: list[UPath],
    config: PerGraspConfig,
    store: Store,
    progress: Callable[[str], None],
    prefix: str = "",
) -> dg.MaterializeResult:
    """Figure 5's table on any shapes, with its figure under a name that begins with `prefix`."""
    from tactile_core.evaluation.protocols import evaluate_per_grasp
    from tactile_core.evaluation.unseen import refuse_known
    from tactile_core.exploration.policies.store import load_policies
    from tactile_core.reconstruction.inference import Reconstructor

    refuse_known(test, seen_by(unet, policies), by_name=not prefix, remedy=REMEDY[bool(prefix)])
    trained = load_policies(policies, unet.version(), unet.resolution)
    table = evaluate_per_grasp(trained, test, Reconstructor(unet), config, progress)
    return stored(table, **curve(table, "grasp", config, store, prefix))


def seen_by(unet: TrainedUNet, policies: list[UPath]) -> dict[str, pd.DataFrame]:
    """The models that the U-Net and each policy were trained on."""
    from tactile_core.exploration.policies.store import trained_on

    return {"the U-Net": unet.trained_on, **trained_on(policies)}


def curve(
    table: pd.DataFrame, index: str, settings: EvaluationSettings, store: Store, prefix: str
) -> dict[str, Any]:
    """Figure 4 ("step") or 5 ("grasp") and its values, as metadata."""
    from tactile_core.evaluation.tables import policy_results
    from tactile_core.figures.curves import policy_curves
    from tactile_core.figures.style import png

    figure = {"step": "figure_4.png", "grasp": "figure_5.png"}[index]
    results = policy_results(table, index, settings.resamples, settings.seed)
    return {
        "samples": table["sample_id"].nunique(),
        "jaccard": markdown(results.rows),
        "compared": markdown(results.comparison),
        "curves": store.picture(f"{prefix}{figure}", png(policy_curves(results.curve, index))),
        "made": dg.MetadataValue.json(made_with(settings)),
    }


def example_runs(
    table: pd.DataFrame,
    trained: list[Any],
    test: Any,
    reconstructor: Any,
    settings: EvaluationSettings,
) -> "list[Rollout]":
    """For each category two rollouts on one shape: by `random`, and by the best trained policy.

    The shape is the one on which the policy's final Jaccard index is the median.
    """
    from tactile_core.evaluation.protocols import record_rollout
    from tactile_core.exploration.policies.references import find_reference

    last = table[table["step"] == table["step"].max()]
    means = [
        last.loc[(last["policy"] == policy.name) & (last["seed"] == policy.seed), "jaccard"].mean()
        for policy in trained
    ]
    best = trained[means.index(max(means))]
    own = last[(last["policy"] == best.name) & (last["seed"] == best.seed)]
    runs = []
    for _, rows in own.groupby("category", sort=True):
        median = rows.sort_values("jaccard", kind="stable")["sample_id"].iloc[len(rows) // 2]
        index = list(test.sample_ids).index(median)
        for policy in (find_reference("random"), best):
            runs.append(record_rollout(policy, test, index, reconstructor, settings))
    return runs
