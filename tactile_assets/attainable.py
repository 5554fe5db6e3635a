"""What can be attained: ideal observers, who know the distribution of shapes but not the shape.

Their assets exist where the profile has an `observer` and the meshes are generated: then as many
more as one likes can be generated to believe in.
"""

import time

import dagster as dg
import pandas as pd
from upath import UPath

from tactile_assets import columns
from tactile_assets.automation import after
from tactile_assets.code_versions import code_version
from tactile_assets.config import PROFILE, StageConfig, defaults
from tactile_assets.evaluation import CODE, READING, TRAINED, PerStepConfig, curve
from tactile_assets.io_managers import UNetsBySeed
from tactile_assets.metadata import counts, seconds_since, stored, wing
from tactile_assets.reconstruction import UNETS
from tactile_assets.resources import Store
from tactile_core.settings import MeshSettings, ObserverSettings

PREFIX = "attainable_"  # of the figure


@defaults(PROFILE.observer or ObserverSettings())
class ObserverConfig(StageConfig, ObserverSettings):
    """The ideal observers."""


@dg.asset(
    kinds={"trimesh", "parquet"},
    code_version=code_version("dataset.real", PROFILE.observer, PROFILE.masks, PROFILE.splits),
    **wing("evaluation"),
)
def believed_shapes(
    context: dg.AssetExecutionContext, config: ObserverConfig, store: Store
) -> dg.MaterializeResult:
    """Freshly generated shapes, which the ideal observers believe in.

    They are of the distribution that the data set is of, rendered and rotated like it, and none of
    them is in it.
    """
    from tactile_core.dataset.real import render_real

    table, _ = render_real(
        MeshSettings(procedural_models=config.believed, seed=config.seed),
        PROFILE.masks,
        PROFILE.splits,
        store.path("believed_meshes"),
        store.work(),
        previous=store.previous("believed_shapes"),
        progress=context.log.info,
    )
    return stored(
        table,
        columns.ROTATED,
        models_by_class=counts(table.drop_duplicates("model_id"), "split", "category"),
        samples=len(table),
    )


@dg.asset(
    kinds={"pytorch", "openvino", "parquet"},
    code_version=code_version(*CODE, "evaluation.attainable", PROFILE.observer),
    automation_condition=after(*TRAINED),
    ins=UNETS,
    **wing("evaluation"),
)
def attainable_rollouts(
    context: dg.AssetExecutionContext,
    config: ObserverConfig,
    store: Store,
    believed_shapes: pd.DataFrame,
    rotated_splits: pd.DataFrame,
    outlines: pd.DataFrame,
    unets: UNetsBySeed,
    policies: list[UPath],
) -> dg.MaterializeResult:
    """Ten rays of each ideal observer on test samples of different models.

    It weighs the believed shapes by what was felt, and casts the ray after which, over shapes drawn
    from them, the Jaccard index is highest; a second observer looks at the ray after that as well,
    with the rays that `gain` proposes. Of several U-Nets they go with the first.
    """
    from tactile_core.dataset.rendering.pictures import decode_masks
    from tactile_core.dataset.shapes import load_shapes
    from tactile_core.evaluation.attainable import cast_observers
    from tactile_core.evaluation.of_each_unet import policies_of_each
    from tactile_core.exploration.policies.scorer import ScorerPolicy

    seed, unet = next(iter(unets.items()))
    trained = policies_of_each(policies, unets)[seed]
    scorers = [policy.net for policy in trained if isinstance(policy, ScorerPolicy)]
    began = time.perf_counter()
    table = cast_observers(
        load_shapes(rotated_splits, outlines, "test"),
        seed,
        unet,
        decode_masks(believed_shapes["mask"]),
        scorers[0] if scorers else None,
        config,
        store.previous("attainable_rollouts"),
        context.log.info,
        work=store.work("attainable_rollouts"),
    )
    return stored(
        table,
        columns.ROLLOUTS,
        rays=len(table),
        samples=table["sample_id"].nunique(),
        seconds=seconds_since(began),
    )


@dg.asset(
    code_version=code_version("evaluation.attainable", "evaluation.statistics", PROFILE.per_step),
    automation_condition=after("attainable_rollouts", "rollouts"),
    **READING,
)
def attainable_evaluation(
    config: PerStepConfig,
    store: Store,
    attainable_rollouts: pd.DataFrame,
    rollouts: pd.DataFrame,
) -> dg.MaterializeResult:
    """The policies beside the ideal observers on the same samples: Jaccard index after each ray.

    "attained" is how much of the way from `random` to the better observer a policy comes.
    """
    from tactile_core.evaluation.attainable import attainable_reading

    table = attainable_reading(attainable_rollouts, rollouts, config)
    return stored(table, columns.PER_STEP, **curve(table, "step", config, store, PREFIX))


ASSETS = [believed_shapes, attainable_rollouts, attainable_evaluation]
