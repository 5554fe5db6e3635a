"""Checks of the search, the U-Net and what it reconstructs."""

import dagster as dg
import pandas as pd

from tactile_assets.checks.telling import UNLESS_SMOKE
from tactile_assets.io_managers import UNetsBySeed
from tactile_assets.metadata import number

OVERFIT_JACCARD = 90.0


@dg.asset_check(
    asset="unet_search",
    additional_ins={
        "rotated_splits": dg.AssetIn("rotated_splits"),
        "outlines": dg.AssetIn("outlines"),
    },
)
def a_unet_can_overfit(rotated_splits: pd.DataFrame, outlines: pd.DataFrame) -> dg.AssetCheckResult:
    """A small U-Net learns a handful of shapes by heart at 60 touches (report, section V)."""
    from tactile_core.dataset.shapes import load_shapes
    from tactile_core.reconstruction.scores import overfit_jaccard
    from tactile_core.threads import one_thread

    with one_thread():
        jaccard = overfit_jaccard(load_shapes(rotated_splits, outlines, "train"))
    return dg.AssetCheckResult(
        passed=jaccard >= OVERFIT_JACCARD,
        description=f"Jaccard index {jaccard:.1f}; {OVERFIT_JACCARD:.0f} is expected",
        metadata={"jaccard": number(jaccard)},
    )


@dg.asset_check(asset="unet", additional_ins={"rotated_splits": dg.AssetIn("rotated_splits")})
def the_unet_is_sound(unet: UNetsBySeed, rotated_splits: pd.DataFrame) -> dg.AssetCheckResult:
    """No weight is infinite or no number, and the U-Net was trained at the masks' resolution."""
    broken = sum(
        int((~weights.isfinite()).sum())
        for of_seed in unet.values()
        for weights in of_seed.weights.values()
    )
    [trained_at] = {of_seed.resolution for of_seed in unet.values()}
    resolution = int(rotated_splits["resolution"].iloc[0])
    return dg.AssetCheckResult(
        passed=not broken and trained_at == resolution,
        description=f"{broken} weights are not finite; the U-Net's resolution is "
        f"{trained_at}, the masks' {resolution}",
        metadata={"weights_not_finite": broken, "resolution": trained_at},
    )


@dg.asset_check(
    asset="reconstruction_evaluation",
    additional_ins={
        "rotated_splits": dg.AssetIn("rotated_splits"),
        "outlines": dg.AssetIn("outlines"),
    },
)
def the_unet_beats_the_mean_shape(
    reconstruction_evaluation: pd.DataFrame, rotated_splits: pd.DataFrame, outlines: pd.DataFrame
) -> dg.AssetCheckResult:
    """On the test split the U-Net is better than always predicting the mean training shape."""
    from tactile_core.dataset.shapes import load_shapes
    from tactile_core.reconstruction.scores import mean_shape_jaccard

    table = reconstruction_evaluation
    of_each = table[(table["split"] == "test") & table["touches"].isna()]
    jaccard = float(of_each["jaccard"].mean())
    mean_shape = mean_shape_jaccard(
        load_shapes(rotated_splits, outlines, "train"),
        load_shapes(rotated_splits, outlines, "test"),
    )
    return dg.AssetCheckResult(
        passed=jaccard > mean_shape,
        severity=UNLESS_SMOKE,
        description=f"Jaccard index {jaccard:.1f}; the mean shape has {mean_shape:.1f}",
        metadata={"jaccard": number(jaccard), "jaccard_of_the_mean_shape": number(mean_shape)},
    )
