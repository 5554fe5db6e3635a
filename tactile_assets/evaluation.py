"""Report, section VII: the policies on shapes that nothing was trained on."""

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import dagster as dg
import pandas as pd
from upath import UPath

from tactile_assets import columns
from tactile_assets.automation import FRESHNESS, after
from tactile_assets.code_versions import code_version
from tactile_assets.config import PROFILE, StageConfig, defaults
from tactile_assets.io_managers import UNetsBySeed
from tactile_assets.metadata import numbers, seconds_since, shown, stored, wing
from tactile_assets.provenance import made_with
from tactile_assets.reconstruction import UNETS, seen_by
from tactile_assets.resources import Store
from tactile_core.exploration.policies.references import REFERENCES
from tactile_core.settings import CHOICES, EvaluationSettings, RolloutSettings

if TYPE_CHECKING:
    from tactile_core.dataset.shapes import Shapes
    from tactile_core.evaluation.replay import Rollout


@defaults(PROFILE.rollouts, references=REFERENCES, choices=CHOICES)
class RolloutConfig(StageConfig, RolloutSettings):
    """Rays of every policy on every test sample."""


@defaults(PROFILE.per_step)
class PerStepConfig(StageConfig, EvaluationSettings):
    """Ten rays of each policy on every test sample."""


@defaults(PROFILE.per_grasp)
class PerGraspConfig(StageConfig, EvaluationSettings):
    """Rays of each policy on every test sample until ten touches are held."""


# What helps where a test model was trained on: in the test split, and among real meshes.
REMEDY = {
    False: "the splits have been dealt anew since, materialise unet and policies again",
    True: "TACTILE_REAL must name other meshes than those of the data set",
}
# Rollouts are cast anew where these are new. A new U-Net alone has none that go with it.
TRAINED = ("policies",)
CODE = (
    "evaluation.of_each_unet", "evaluation.replay", "evaluation.unseen",
    "exploration.policies.store", "reconstruction.inference",
)  # fmt: skip
READING: dict[str, Any] = {
    "kinds": {"matplotlib", "parquet"},
    "freshness_policy": FRESHNESS,
    **wing("evaluation"),
}
# The numbers beside a table are of the bootstrap.
READ = "evaluation.readings", "evaluation.statistics"
PER_STEP = code_version(*READ, PROFILE.per_step)
PER_GRASP = code_version(*READ, PROFILE.per_grasp)


@dg.asset(
    kinds={"pytorch", "openvino", "parquet"},
    code_version=code_version(*CODE, PROFILE.rollouts),
    automation_condition=after(*TRAINED),
    ins=UNETS,
    **wing("evaluation"),
)
def rollouts(
    context: dg.AssetExecutionContext,
    config: RolloutConfig,
    store: Store,
    rotated_splits: pd.DataFrame,
    outlines: pd.DataFrame,
    unets: UNetsBySeed,
    policies: list[UPath],
) -> dg.MaterializeResult:
    """Every ray of every policy on every test sample: until ten are cast and ten touches held.

    Reference policies stand beside the trained ones: `random`, as in the report; `even`, a fixed
    sweep; `coverage` and `uncertainty`, which look at the reconstruction; and `oracle`, which
    knows the mask and takes, of 396 rays, the one that gains most. `recall` tries the best rays of
    `gain` on train shapes that agree with what was felt. Both evaluations read this table. What a
    policy cast before is kept as long as it, the U-Net, the shapes and the settings are the same.
    Where there are several U-Nets, policies go with that of their own seed, and rules with each.
    """
    from tactile_core.dataset.shapes import load_shapes

    test = load_shapes(rotated_splits, outlines, "test")
    return cast_all(test, unets, policies, config, store, context.log.info)


@dg.asset(code_version=PER_STEP, automation_condition=after("rollouts"), **READING)
def per_step_evaluation(
    config: PerStepConfig, store: Store, rollouts: pd.DataFrame
) -> dg.MaterializeResult:
    """Ten rays of every policy on every test sample: the Jaccard index after each (Figure 4).

    Policies that have a distribution of rays draw theirs from it, or take the likeliest, as
    `choice` says. With intervals over models, and every policy beside the best fixed rule.
    """
    return per_step(rollouts, config, store)


@dg.asset(code_version=PER_GRASP, automation_condition=after("rollouts"), **READING)
def per_grasp_evaluation(
    config: PerGraspConfig, store: Store, rollouts: pd.DataFrame
) -> dg.MaterializeResult:
    """Rays of every policy until ten touches are held: the Jaccard index at each (Figure 5).

    It tells whether a policy chooses better touches, or only misses less often. How many rays
    it took is in the table too. Where the ray limit was reached first, a touch that was never
    made is a row without a Jaccard index.
    """
    return per_grasp(rollouts, config, store)


def cast_all(
    test: "Shapes",
    unets: UNetsBySeed,
    policies: list[UPath],
    config: RolloutConfig,
    store: Store,
    progress: Callable[[str], None],
    prefix: str = "",
) -> dg.MaterializeResult:
    """The rollouts on any shapes, as the asset `rollouts` with `prefix` before its name and before
    the names of its pictures."""
    from tactile_core.evaluation.of_each_unet import cast_with_each, policies_of_each
    from tactile_core.evaluation.unseen import refuse_known
    from tactile_core.exploration.policies.store import trained_on
    from tactile_core.figures.animation import rollout_gif
    from tactile_core.figures.rollouts import runs_figure, steps_figure
    from tactile_core.figures.style import png
    from tactile_core.reconstruction.inference import Reconstructor
    from tactile_core.reconstruction.unets import first_of

    seen = seen_by(unets) | trained_on(policies)
    refuse_known(test, seen, by_name=not prefix, remedy=REMEDY[bool(prefix)])
    trained = policies_of_each(policies, unets)
    previous = store.previous(f"{prefix}rollouts")
    began = time.perf_counter()
    table = cast_with_each(
        trained, test, unets, config, previous, progress, store.work(f"{prefix}rollouts")
    )
    names = [(one.name, one.seed) for some in trained.values() for one in some]
    runs = example_runs(table, names, test, unets, config)
    return stored(
        table,
        columns.ROLLOUTS,
        one_rollout_in_motion=store.picture(f"{prefix}run.gif", rollout_gif(runs[-1])),
        one_rollout_ray_by_ray=store.picture(f"{prefix}figure_2.png", png(steps_figure(runs[-1]))),
        random_and_the_best_policy=store.picture(
            f"{prefix}figure_3.png", png(runs_figure(runs), width_px=540)
        ),
        rays=len(table),
        samples=table["sample_id"].nunique(),
        policies=len(table[["policy", "seed"]].drop_duplicates()),
        unet_runs_through=Reconstructor(first_of(unets)).runs,
        seconds=seconds_since(began),
    )


def per_step(
    rollouts: pd.DataFrame, config: PerStepConfig, store: Store, prefix: str = ""
) -> dg.MaterializeResult:
    """Figure 4's table of any rollouts, with its figure under a name that begins with `prefix`."""
    from tactile_core.evaluation.readings import per_step_reading

    table = per_step_reading(rollouts, config)
    return stored(table, columns.PER_STEP, **curve(table, "step", config, store, prefix))


def per_grasp(
    rollouts: pd.DataFrame, config: PerGraspConfig, store: Store, prefix: str = ""
) -> dg.MaterializeResult:
    """Figure 5's table of any rollouts, with its figure under a name that begins with `prefix`."""
    from tactile_core.evaluation.readings import per_grasp_reading

    table = per_grasp_reading(rollouts, config)
    return stored(table, columns.PER_GRASP, **curve(table, "grasp", config, store, prefix))


def curve(
    table: pd.DataFrame, index: str, settings: EvaluationSettings, store: Store, prefix: str
) -> dict[str, Any]:
    """Figure 4 ("step") or 5 ("grasp") and its values, as metadata."""
    from tactile_core.evaluation.tables import policy_results
    from tactile_core.figures.curves import policy_curves
    from tactile_core.figures.style import png

    shows, figure, word = {
        "step": ("jaccard_after_each_ray", "figure_4.png", "ray"),
        "grasp": ("jaccard_at_each_touch", "figure_5.png", "touch"),
    }[index]
    last = table[index].max()
    results = policy_results(table, index, settings.resamples, settings.seed)
    of_each = results.summary.set_index("policy")
    return {
        shows: store.picture(f"{prefix}{figure}", png(policy_curves(results.curve, index))),
        "jaccard_by_policy": shown(results.rows[["policy", f"{word} {last}", "mean", "gap, mean"]]),
        "above_the_fixed_rules": shown(results.comparison.filter(regex="^policy$|^above")),
        "samples": table["sample_id"].nunique(),
        **numbers(f"jaccard at {word} {last}", of_each["last"]),
        **numbers("jaccard, mean over all", of_each["mean"]),
        **numbers("gap closed", of_each["mean_gap"]),
        "made_with": dg.MetadataValue.json(made_with(settings)),
    }


def example_runs(
    table: pd.DataFrame,
    trained: list[tuple[str, int]],
    test: "Shapes",
    unets: UNetsBySeed,
    settings: RolloutSettings,
) -> "list[Rollout]":
    """For each category two rollouts on one shape: by `random`, if it is among the references, and
    by the best of the trained policies (name, seed), or of all where there are none.

    The shape is the one on which that policy's Jaccard index after `settings.count` rays is the
    median. Of a policy that draws its rays the last of `settings.choices` is shown.
    """
    from tactile_core.evaluation.replay import replayed
    from tactile_core.reconstruction.inference import Reconstructor
    from tactile_core.reconstruction.unets import seed_of

    shown = table[
        (table["ray"] <= settings.count) & table["choice"].isin(["rule", settings.choices[-1]])
    ].set_index(["policy", "seed"])
    last = shown[shown["ray"] == settings.count]
    means = last.groupby(level=["policy", "seed"])["jaccard"].mean()
    best = means.loc[trained or means.index].idxmax()
    seed = seed_of(unets, best[1])
    reconstructor = Reconstructor(unets[seed])
    runs = []
    for _, rows in last.loc[[best]].groupby("category", sort=True):
        median = rows.sort_values("jaccard", kind="stable")["sample_id"].iloc[len(rows) // 2]
        index = list(test.sample_ids).index(median)
        on_it = shown[shown["sample_id"] == median].reset_index()
        for name, of in [("random", seed), best]:
            rays = on_it[(on_it["policy"] == name) & (on_it["seed"] == of)]
            if len(rays):
                runs.append(replayed(rays, test, index, reconstructor))
    return runs
