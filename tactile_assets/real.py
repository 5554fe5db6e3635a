"""Generalisation: the same policies on real meshes, which exist where TACTILE_REAL names some."""

from typing import TYPE_CHECKING

import dagster as dg
import pandas as pd
from upath import UPath

from tactile_assets import columns
from tactile_assets.automation import after
from tactile_assets.checks.dataset import inside_the_circle
from tactile_assets.code_versions import code_version
from tactile_assets.config import PROFILE, StageConfig, defaults
from tactile_assets.evaluation import (
    CODE,
    PER_GRASP,
    PER_STEP,
    READING,
    TRAINED,
    PerGraspConfig,
    PerStepConfig,
    RolloutConfig,
    cast_all,
    per_grasp,
    per_step,
)
from tactile_assets.io_managers import TrainedUNet, UNetsBySeed
from tactile_assets.metadata import counts, set_aside, stored, wing
from tactile_assets.reconstruction import UNETS
from tactile_assets.resources import Store
from tactile_assets.sources import versions_read, waited_out
from tactile_core.errors import TactileError
from tactile_core.settings import MeshSettings

if TYPE_CHECKING:
    from tactile_core.dataset.shapes import Shapes

MESHES = PROFILE.meshes.model_copy(update={"location": PROFILE.real})
PREFIX = "real_"  # of the figures: those of the test split stay
AFTER = after("real_rollouts")


@defaults(MESHES)
class RealConfig(StageConfig, MeshSettings):
    """Where the real meshes come from."""


@dg.asset(
    kinds={"shapenet", "trimesh", "parquet"},
    code_version=code_version("dataset.real", MESHES, PROFILE.masks, PROFILE.splits),
    **wing("evaluation"),
)
def real_shapes(
    context: dg.AssetExecutionContext, config: RealConfig, store: Store
) -> dg.MaterializeResult:
    """Real meshes that nothing was trained on, as masks at random rotations.

    They are read, rendered and rotated with the settings of the data set, and every one of them
    is for testing. A mesh that cannot be used is set aside, and counted here with its reason.
    """
    from tactile_core.dataset.real import render_real
    from tactile_core.figures.sheets import mask_sheet
    from tactile_core.figures.style import png

    with waited_out(context):
        versions = versions_read(config)
        table, aside = render_real(
            config,
            PROFILE.masks,
            PROFILE.splits,
            store.path("real_meshes"),
            store.work(),
            previous=store.previous("real_shapes"),
            progress=context.log.info,
        )
    sheet = mask_sheet(table["mask"], table["category"].to_numpy(dtype=str))
    return stored(
        table,
        columns.ROTATED,
        real_masks_by_class=store.picture("real_shapes.png", png(sheet)),
        models_by_class=counts(table.drop_duplicates("model_id"), "split", "category"),
        samples=len(table),
        **set_aside(aside),
        **versions,
    )


@dg.asset(
    kinds={"pytorch", "openvino", "parquet"},
    # Real samples have no asset of their outlines: they are traced here.
    code_version=code_version(*CODE, "dataset.outlines", PROFILE.rollouts),
    automation_condition=after(*TRAINED, "real_shapes"),
    ins=UNETS,
    **wing("evaluation"),
)
def real_rollouts(
    context: dg.AssetExecutionContext,
    config: RolloutConfig,
    store: Store,
    real_shapes: pd.DataFrame,
    unets: UNetsBySeed,
    policies: list[UPath],
) -> dg.MaterializeResult:
    """Every ray of every policy on every real sample, as `rollouts` has them of the test split.

    The policies, the U-Net and the table are those of `rollouts`; only the shapes are others, so
    the two side by side tell how well the training generalises.
    """
    from tactile_core.reconstruction.unets import first_of

    test = shapes_for(first_of(unets), real_shapes)
    return cast_all(test, unets, policies, config, store, context.log.info, PREFIX)


@dg.asset(code_version=PER_STEP, automation_condition=AFTER, **READING)
def real_per_step_evaluation(
    config: PerStepConfig, store: Store, real_rollouts: pd.DataFrame
) -> dg.MaterializeResult:
    """Ten rays of every policy on every real sample: the Jaccard index after each.

    What `per_step_evaluation` reads from the rollouts on the test split, read from those on real
    samples.
    """
    return per_step(real_rollouts, config, store, PREFIX)


@dg.asset(code_version=PER_GRASP, automation_condition=AFTER, **READING)
def real_per_grasp_evaluation(
    config: PerGraspConfig, store: Store, real_rollouts: pd.DataFrame
) -> dg.MaterializeResult:
    """Rays of every policy on real samples until ten touches are held: the Jaccard index at each.

    What `per_grasp_evaluation` reads from the rollouts on the test split, read from those on real
    samples.
    """
    return per_grasp(real_rollouts, config, store, PREFIX)


@dg.asset_check(asset=real_shapes, blocking=True)
def real_samples_lie_inside_the_circle(real_shapes: pd.DataFrame) -> dg.AssetCheckResult:
    """No real mask is empty, and none reaches the circle that rays start from."""
    return inside_the_circle(real_shapes.assign(name=real_shapes["sample_id"]))


ASSETS = [real_shapes, real_rollouts, real_per_step_evaluation, real_per_grasp_evaluation]
CHECKS = [real_samples_lie_inside_the_circle]


def shapes_for(unet: TrainedUNet, real_shapes: pd.DataFrame) -> "Shapes":
    """The real samples as arrays, with their outlines, where the U-Net can see them."""
    from tactile_core.dataset.outlines import trace_outlines
    from tactile_core.dataset.shapes import load_shapes

    shapes = load_shapes(real_shapes, trace_outlines(real_shapes), "test")
    if shapes.resolution != unet.resolution:
        raise TactileError(
            f"real_shapes have resolution {shapes.resolution}, as the profile says, and the U-Net "
            f"was trained at {unet.resolution}: evaluate a U-Net of the profile's resolution"
        )
    return shapes
