"""Report, section VI: policies that choose where to touch next."""

from collections.abc import Iterator, Mapping
from typing import Any

import dagster as dg
import pandas as pd

from tactile_assets.code_versions import code_version
from tactile_assets.config import PROFILE, StageConfig, defaults
from tactile_assets.io_managers import UNetsBySeed
from tactile_assets.metadata import OWNERS, SECTION, curves_at, numbers, shown
from tactile_assets.reconstruction import UNETS
from tactile_assets.resources import Store
from tactile_assets.trainings import POOL, PlannedTraining
from tactile_core.errors import TactileError
from tactile_core.exploration.learning.approaches import APPROACHES
from tactile_core.files import content_hash
from tactile_core.parquet import read_table
from tactile_core.settings import PolicySettings

# Each of the last part of the training, on train shapes.
END_OF_TRAINING = {
    "steps": "Rays cast.",
    "reward": "Mean reward of an episode, before it is scaled.",
    "jaccard": "Mean Jaccard index (0 to 100) at the end of an episode.",
}


@defaults(PROFILE.policies, approaches=APPROACHES)
class PolicyConfig(StageConfig, PolicySettings):
    """Training of the policies."""


@dg.op(out=dg.DynamicOut(PlannedTraining, description="One for each approach and seed."))
def plan_trainings(
    config: PolicyConfig,
    rotated_splits: pd.DataFrame,
    outlines: pd.DataFrame,
    unets: UNetsBySeed,
) -> Iterator[dg.DynamicOutput[PlannedTraining]]:
    """Which policies to train. What would stop every training stops here, once: an approach that is
    not known, an input that is missing, a U-Net of another resolution or of no such seed."""
    from tactile_core.dataset.shapes import load_shapes
    from tactile_core.exploration.learning.approaches import APPROACHES, find_approach
    from tactile_core.reconstruction.unets import unet_of

    shapes = load_shapes(rotated_splits, outlines, "train")
    settings = PolicySettings(**config.model_dump())
    for seed in settings.seeds:
        if shapes.resolution != (trained_at := unet_of(unets, seed).resolution):
            raise TactileError(
                f"rotated_splits have resolution {shapes.resolution}, and the U-Net was trained at "
                f"{trained_at}: materialise unet again"
            )
    recipes = [find_approach(approach) for approach in settings.approaches or APPROACHES]
    # The longest first: begun last, one would be left to train alone on one core.
    recipes.sort(key=lambda recipe: (recipe.learner == "ppo", -len(recipe.stages)))
    for approach in (recipe.name for recipe in recipes):
        for seed in settings.seeds:
            yield dg.DynamicOutput(
                PlannedTraining(approach=approach, seed=seed, settings=settings),
                mapping_key=f"{approach}_{seed}",
            )


@dg.op(
    pool=POOL,
    retry_policy=dg.RetryPolicy(max_retries=2, delay=5, backoff=dg.Backoff.EXPONENTIAL),
)
def train_policy(
    context: dg.OpExecutionContext,
    store: Store,
    training: PlannedTraining,
    rotated_splits: pd.DataFrame,
    outlines: pd.DataFrame,
    unets: UNetsBySeed,
) -> PlannedTraining:
    """Train one policy and store it; goes on from its checkpoint where it was interrupted."""
    from tactile_core.dataset.shapes import load_shapes
    from tactile_core.exploration.learning import train as core
    from tactile_core.exploration.learning.approaches import find_approach
    from tactile_core.reconstruction.unets import unet_of
    from tactile_core.spread import TRAINING, handed_over

    try:
        version = handed_over(
            core.train_policy,
            find_approach(training.approach),
            training.seed,
            load_shapes(rotated_splits, outlines, "train"),
            unet_of(unets, training.seed),
            training.settings,
            directory=store.path("policies", training.name),
            work=store.far_work("policies", training.name),
            needs=TRAINING,
            progress=context.log.info,
        )
    except Exception as error:
        if isinstance(error, OSError | MemoryError):  # of the machine or its network: it may pass
            raise
        raise dg.Failure(str(error), allow_retries=False) from error
    return training.model_copy(update={"version": version})


@dg.op(out=dg.Out(io_manager_key="policy_index"))
def gather_policies(store: Store, trained: list[PlannedTraining]) -> dg.Output[dict[str, str]]:
    """The policies that were trained, by the names of their directories."""
    from tactile_core.figures.curves import training_curves
    from tactile_core.figures.style import png

    versions = {training.name: training.version for training in trained}
    curves = pd.concat(
        read_table(store.path("policies", training.name, "curve.parquet"), "policies").assign(
            approach=training.approach, seed=training.seed
        )
        for training in trained
    )
    last = curves.groupby(["approach", "seed"], sort=False, as_index=False).last()
    names = last["approach"] + "-" + last["seed"].astype(str)
    metadata: dict[str, Any] = {
        "training_curves": store.picture("training_curves.png", png(training_curves(curves))),
        "end_of_training": shown(
            last[["approach", "seed", "steps", "reward", "jaccard"]], END_OF_TRAINING
        ),
        "policies": len(trained),
        **numbers("jaccard at the end of training", last["jaccard"].set_axis(names)),
        **curves_at(store.far_work("policies")),
    }
    version = dg.DataVersion(policies_version(versions))
    return dg.Output(versions, metadata=metadata, data_version=version)


def policies_version(versions: Mapping[str, str]) -> str:
    """The data version of policies, from that of each by the name of its directory."""
    return content_hash(sorted(versions.items()))


@dg.config_mapping(config_schema=PolicyConfig.to_fields_dict())
def policy_config(fields: dict[str, Any]) -> dict[str, Any]:
    """Run config of the asset as run config of the op that plans the trainings."""
    return {"plan_trainings": {"config": fields}}


@dg.graph_asset(
    group_name="exploration",
    kinds={"gymnasium", "stablebaselines3", "pytorch"},
    owners=OWNERS,
    tags=SECTION["exploration"],
    code_version=code_version(
        "exploration.learning.train",
        "exploration.learning.approaches",
        "reconstruction.unets",
        PROFILE.policies,
    ),
    config=policy_config,
    ins=UNETS,
)
def policies(
    rotated_splits: pd.DataFrame, outlines: pd.DataFrame, unets: UNetsBySeed
) -> dict[str, str]:
    """Policies trained to choose the next ray from what was felt so far.

    One for each training approach and seed. PPO trains the report's: `diff` and `total` reward
    what a ray adds to the Jaccard index or the index itself, with -10 for a miss or a repeat;
    `total_miss` and `pre_diff_miss` begin without penalty. `gain` learns what each of many
    candidate rays adds; with it are stored the train shapes, which `recall` tries its rays on.
    `sequence` are the ten rays that are best on average, the same for every shape.
    Those of a seed are trained with the U-Net of that seed, where there is more than one. Where
    the U-Net knows shapes, policies are trained on every second model, which it forgets.
    Each training is a step of its own, retried and resumed on its own.
    """
    trained = plan_trainings(rotated_splits, outlines, unets).map(
        lambda training: train_policy(
            training, rotated_splits=rotated_splits, outlines=outlines, unets=unets
        )
    )
    return gather_policies(trained.collect())
