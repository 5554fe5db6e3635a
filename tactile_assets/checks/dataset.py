"""Checks of meshes, masks, splits, outlines and touches."""

import dagster as dg
import numpy as np
import pandas as pd

from tactile_assets.checks.telling import first
from tactile_assets.metadata import counts, number, shown

HOW_ONE_KNOWS_AN_OBJECT = ("model_id", "content_hash", "geometry", "copy_of")


@dg.asset_check(asset="shapenet_meshes")
def meshes_are_usable(shapenet_meshes: pd.DataFrame) -> dg.AssetCheckResult:
    """Counts the meshes that were set aside because they could not be used."""
    aside = shapenet_meshes.loc[
        shapenet_meshes["status"] != "ok", ["model_id", "category", "status"]
    ]
    return dg.AssetCheckResult(
        passed=aside.empty,
        severity=dg.AssetCheckSeverity.WARN,
        description=f"{len(aside)} of {len(shapenet_meshes)} meshes set aside",
        metadata={"set_aside": len(aside), "meshes_set_aside": shown(aside.head(20))},
    )


@dg.asset_check(asset="masks")
def masks_lie_inside_the_circle(masks: pd.DataFrame) -> dg.AssetCheckResult:
    """No mask is empty, and none reaches the circle that rays start from."""
    usable = masks[masks["status"] == "ok"]
    return inside_the_circle(usable.assign(name=usable["model_id"]))


@dg.asset_check(asset="rotated_splits", blocking=True)
def samples_lie_inside_the_circle(rotated_splits: pd.DataFrame) -> dg.AssetCheckResult:
    """No rotated mask is empty, and none reaches the circle that rays start from."""
    return inside_the_circle(rotated_splits.assign(name=rotated_splits["sample_id"]))


def inside_the_circle(table: pd.DataFrame) -> dg.AssetCheckResult:
    from tactile_core.dataset.rendering.pictures import decoded

    found = []
    for pictures in decoded(table["mask"]):
        size = pictures.shape[-1]
        middle = size / 2 - 1
        rows, columns = np.indices((size, size))
        outside = np.hypot(rows - middle, columns - middle) >= middle
        found.append([~pictures.any(axis=(1, 2)), (pictures & outside).any(axis=(1, 2))])
    empty, beyond = np.concatenate(found, axis=1)
    return dg.AssetCheckResult(
        passed=not (empty.any() or beyond.any()),
        description=f"{empty.sum()} of {len(table)} are empty, {beyond.sum()} reach the circle",
        metadata={
            "empty": int(empty.sum()),
            "beyond_the_circle": int(beyond.sum()),
            "first": first(table["name"][empty | beyond]),
        },
    )


@dg.asset_check(asset="rotated_splits", blocking=True)
def no_model_in_two_splits(rotated_splits: pd.DataFrame) -> dg.AssetCheckResult:
    """No model stands in two splits, nor a copy of it under another name: tests would be worthless.

    Copies are known by their bytes, their geometry and their silhouette.
    """
    shared = {
        column: splits[splits > 1]
        for column in HOW_ONE_KNOWS_AN_OBJECT
        for splits in [rotated_splits.groupby(column)["split"].nunique()]
    }
    leaked = pd.concat(
        [rotated_splits[column].isin(found.index) for column, found in shared.items()], axis=1
    ).any(axis=1)
    models = rotated_splits.loc[leaked, "model_id"].unique()
    return dg.AssetCheckResult(
        passed=len(models) == 0,
        description=f"{len(models)} models stand in two splits or more",
        metadata={"models_in_two_splits": len(models), "first": first(models)},
    )


@dg.asset_check(asset="rotated_splits")
def classes_are_balanced(rotated_splits: pd.DataFrame) -> dg.AssetCheckResult:
    """Every split has every class, in equal shares to within one model or 5 %."""
    from tactile_core.dataset.shapes import SPLITS

    models = rotated_splits.drop_duplicates("model_id")
    by_split = pd.crosstab(models["split"], models["category"]).reindex(SPLITS, fill_value=0)
    sizes = by_split.sum(axis=1)
    shares = models["category"].value_counts(normalize=True)
    off = by_split.apply(lambda row: (row - sizes[row.name] * shares).abs(), axis=1)
    allowed = np.maximum(1, 0.05 * sizes)
    lacking = [
        f"{category} is missing in {', '.join(column.index[column == 0])}"
        for category, column in by_split.items()
        if (column == 0).any()
    ]
    shares_off = f"splits are {off.max(axis=None):.1f} models off equal shares at most"
    return dg.AssetCheckResult(
        passed=not lacking and not off.gt(allowed, axis=0).any(axis=None),
        description="; ".join([*lacking, shares_off]),
        metadata={
            "models_by_split": counts(models, "split", "category"),
            "models_off_equal_shares": number(off.max(axis=None)),
        },
    )


@dg.asset_check(asset="outlines", additional_ins={"rotated_splits": dg.AssetIn("rotated_splits")})
def outlines_lie_on_their_masks(
    outlines: pd.DataFrame, rotated_splits: pd.DataFrame
) -> dg.AssetCheckResult:
    """Every sample has an outline, and every pixel of it belongs to the sample's mask."""
    from tactile_core.dataset.rendering.pictures import decode_masks

    mask_of = dict(zip(rotated_splits["sample_id"], rotated_splits["mask"], strict=True))
    wrong = []
    for sample, outline in zip(outlines["sample_id"], outlines["outline"], strict=True):
        mask = decode_masks([mask_of[sample]])[0] if sample in mask_of else None
        if mask is None or not len(outline) or not mask[tuple(outline.T)].all():
            wrong.append(sample)
    without = set(mask_of) - set(outlines["sample_id"])
    return dg.AssetCheckResult(
        passed=not wrong and not without,
        description=f"{len(wrong)} of {len(outlines)} outlines are not their mask's, "
        f"{len(without)} samples have none",
        metadata={
            "off_their_mask": len(wrong),
            "without_an_outline": len(without),
            "first": first([*wrong, *sorted(without)]),
        },
    )


@dg.asset_check(
    asset="tactile_samples",
    blocking=True,
    additional_ins={"outlines": dg.AssetIn("outlines")},
)
def touches_lie_on_outlines(
    tactile_samples: pd.DataFrame, outlines: pd.DataFrame
) -> dg.AssetCheckResult:
    """Every touch is a pixel of its sample's outline, and no set holds one twice."""
    from tactile_core.dataset.touches import differ_and_lie_on

    outline_of = dict(zip(outlines["sample_id"], outlines["outline"], strict=True))
    nothing = np.zeros((0, 2), np.int16)
    wrong = [
        sample
        for sample, touches in zip(
            tactile_samples["sample_id"], tactile_samples["touches"], strict=True
        )
        if not differ_and_lie_on(touches, outline_of.get(sample, nothing))
    ]
    return dg.AssetCheckResult(
        passed=not wrong,
        description=f"{len(wrong)} of {len(tactile_samples)} sets have touches off their outline",
        metadata={"sets_off_their_outline": len(wrong), "first": first(wrong)},
    )
