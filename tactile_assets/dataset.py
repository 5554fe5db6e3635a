"""Report, section IV: from ShapeNet archives to masks, outlines and touches."""

import time

import dagster as dg
import numpy as np
import pandas as pd

from tactile_assets import columns
from tactile_assets.code_versions import code_version
from tactile_assets.config import PROFILE, StageConfig, defaults
from tactile_assets.metadata import (
    counts,
    number,
    renewed,
    seconds_since,
    set_aside,
    shown,
    stored,
    wing,
)
from tactile_assets.resources import Store
from tactile_assets.sources import versions_read, waited_out
from tactile_core.settings import MaskSettings, MeshSettings, SplitSettings, TouchSettings


@defaults(PROFILE.meshes)
class MeshConfig(StageConfig, MeshSettings):
    """Where the 3D models come from."""


@defaults(PROFILE.masks)
class MaskConfig(StageConfig, MaskSettings):
    """How a mesh becomes a silhouette."""


@defaults(PROFILE.splits)
class SplitConfig(StageConfig, SplitSettings):
    """Train, eval and test models, and their rotations."""


@defaults(PROFILE.touches)
class TouchConfig(StageConfig, TouchSettings):
    """Touch sets drawn from each outline."""


@dg.asset(
    kinds={"shapenet", "trimesh", "parquet"},
    code_version=code_version("dataset.meshes", PROFILE.meshes),
    **wing("dataset"),
)
def shapenet_meshes(
    context: dg.AssetExecutionContext, config: MeshConfig, store: Store
) -> dg.MaterializeResult:
    """The 3D models that everything starts from, and a manifest of them.

    ShapeNet archives, folders of your own meshes, or generated mugs and bottles: `location`
    says where the first two lie, and without it meshes are generated. A class is added by
    naming it and its synset. Each row of the manifest is a mesh, with its source, size, content
    hash and status; one that cannot be used stays in it with the reason.
    """
    from tactile_core.dataset.meshes import collect_meshes

    with waited_out(context):
        versions = versions_read(config)
        manifest = collect_meshes(
            config, store.path("shapenet_meshes"), store.work(), progress=context.log.info
        )
    usable = manifest[manifest["status"] == "ok"]
    by_class = usable.groupby("category", as_index=False).agg(
        source=("source", "first"), meshes=("file", "size"), median_faces=("faces", "median")
    )
    return stored(
        manifest,
        columns.MESHES,
        meshes_by_class=shown(by_class),
        meshes=len(usable),
        **set_aside(manifest),
        **versions,
    )


@dg.asset(
    kinds={"pyrender", "numba", "parquet"},
    code_version=code_version("dataset.rendering.silhouettes", PROFILE.masks),
    **wing("dataset"),
)
def masks(
    context: dg.AssetExecutionContext,
    config: MaskConfig,
    store: Store,
    shapenet_meshes: pd.DataFrame,
) -> dg.MaterializeResult:
    """One silhouette per mesh: a binary picture, 1 where the object projects.

    All are seen from the same perspective, by an orthographic camera that looks horizontally at
    45° azimuth. PyRender draws them where OpenGL is to be had, else our own rasteriser, with
    equal pixels. Meshes that have not changed are not rendered again.
    """
    from tactile_core.dataset.rendering.pictures import decoded
    from tactile_core.dataset.rendering.silhouettes import render_masks
    from tactile_core.figures.sheets import mask_sheet
    from tactile_core.figures.style import png

    previous = store.previous("masks")
    began = time.perf_counter()
    table = render_masks(
        shapenet_meshes,
        store.path("shapenet_meshes"),
        config,
        previous=previous,
        progress=context.log.info,
    )
    usable = table[table["status"] == "ok"]
    covered = sum(int(some.sum()) for some in decoded(usable["mask"]))
    categories = usable["category"].to_numpy(dtype=str)
    return stored(
        table,
        columns.MASKS,
        masks_by_class=store.picture("masks.png", png(mask_sheet(usable["mask"], categories))),
        masks=len(usable),
        **renewed(usable, previous),
        set_aside=len(table) - len(usable),
        resolution=config.resolution,
        covered_percent=number(100 * covered / (len(usable) * config.resolution**2)),
        seconds=seconds_since(began),
    )


@dg.asset(
    kinds={"numpy", "parquet"},
    code_version=code_version("dataset.splits", PROFILE.splits),
    **wing("dataset"),
)
def rotated_splits(
    context: dg.AssetExecutionContext,
    config: SplitConfig,
    store: Store,
    shapenet_meshes: pd.DataFrame,
    masks: pd.DataFrame,
) -> dg.MaterializeResult:
    """Train, eval and test models (80/10/10), each at five random in-plane rotations.

    The models of each class are split first and rotated afterwards, so that no object is seen
    in training and in a test, however it is turned. Rotations are rendered anew from the
    geometry: no pixel is resampled.
    """
    from tactile_core.dataset.splits import rotate_splits
    from tactile_core.figures.sheets import mask_sheet
    from tactile_core.figures.style import png

    rendering = MaskSettings(resolution=int(masks["resolution"].iloc[0]), renderer=config.renderer)
    previous = store.previous("rotated_splits")
    began = time.perf_counter()
    table = rotate_splits(
        masks,
        shapenet_meshes,
        store.path("shapenet_meshes"),
        rendering,
        config,
        previous=previous,
        progress=context.log.info,
    )
    train = table[table["split"] == "train"]
    sheet = mask_sheet(train["mask"], train["category"].to_numpy(dtype=str))
    return stored(
        table,
        columns.ROTATED,
        train_masks_by_class=store.picture("rotated_splits.png", png(sheet)),
        models_by_split=counts(table.drop_duplicates("model_id"), "split", "category"),
        samples_by_split=counts(table, "split", "category"),
        samples=len(table),
        **renewed(table, previous),
        copies=table["model_id"].nunique() - table["copy_of"].nunique(),
        seconds=seconds_since(began),
    )


@dg.asset(
    kinds={"scipy", "parquet"},
    code_version=code_version("dataset.outlines"),
    **wing("dataset"),
)
def outlines(
    context: dg.AssetExecutionContext, store: Store, rotated_splits: pd.DataFrame
) -> dg.MaterializeResult:
    """The outline of each sample: every mask pixel that a ray from outside can reach.

    Concavities belong to it, such as the inside of a handle that is open to one side; holes do
    not, as no ray gets there. Touches can lie nowhere else.
    """
    from tactile_core.dataset.outlines import trace_outlines
    from tactile_core.figures.sheets import touch_sheet
    from tactile_core.figures.style import png

    previous = store.previous("outlines")
    table = trace_outlines(rotated_splits, previous, context.log.info)
    lengths = table["outline"].map(len)
    untouched = [np.empty((0, 2), int)] * len(table)
    categories = table["category"].to_numpy(dtype=str)
    sheet = touch_sheet(rotated_splits["mask"], list(table["outline"]), untouched, categories)
    return stored(
        table,
        columns.OUTLINES,
        outlines_by_class=store.picture("outlines.png", png(sheet)),
        samples=len(table),
        **renewed(table, previous, "mask_hash"),
        shortest_outline=int(lengths.min()),
        median_outline=number(lengths.median()),
        longest_outline=int(lengths.max()),
    )


@dg.asset(
    kinds={"numpy", "parquet"},
    code_version=code_version("dataset.touches", PROFILE.touches),
    **wing("dataset"),
)
def tactile_samples(
    context: dg.AssetExecutionContext,
    config: TouchConfig,
    store: Store,
    rotated_splits: pd.DataFrame,
    outlines: pd.DataFrame,
) -> dg.MaterializeResult:
    """Sets of 1 to 10 touches drawn from each outline: what a hand may have felt so far.

    Table II is measured on these sets. Nets learn from those of the train split where their
    setting `touches` says "stored", as the report's do; else from fresh ones, so that none can
    be learnt by heart.
    """
    from tactile_core.dataset.touches import sample_touches
    from tactile_core.figures.sheets import touch_sheet
    from tactile_core.figures.style import png

    table = sample_touches(outlines, config, context.log.info)
    first = table[table["set"] == 0].reset_index(drop=True)
    categories = rotated_splits["category"].to_numpy(dtype=str)
    sheet = touch_sheet(
        rotated_splits["mask"], outlines["outline"].array, first["touches"].array, categories
    )
    sizes = table["touches"].map(len).value_counts().sort_index()
    return stored(
        table,
        columns.TOUCHES,
        touches_on_outlines=store.picture("tactile_samples.png", png(sheet)),
        sets=len(table),
        sets_by_touches=shown(sizes.rename_axis("touches").reset_index(name="sets")),
    )
