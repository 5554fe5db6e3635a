"""Checks where a wrong result would otherwise look fine. Each reads what the assets stored."""

from collections.abc import Iterable

import dagster as dg
import numpy as np
import pandas as pd
from upath import UPath

from tactile_assets.config import PROFILE
from tactile_assets.io_managers import TrainedUNet
from tactile_assets.metadata import counts, number, numbers, shown

# Trained for a few seconds, nothing has to be good yet.
UNLESS_SMOKE = (
    dg.AssetCheckSeverity.WARN if PROFILE.name == "smoke" else dg.AssetCheckSeverity.ERROR
)
OVERFIT_JACCARD = 90.0
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
    models = rotated_splits.drop_duplicates("model_id")
    by_split = pd.crosstab(models["split"], models["category"])
    sizes = by_split.sum(axis=1)
    shares = models["category"].value_counts(normalize=True)
    off = by_split.apply(lambda row: (row - sizes[row.name] * shares).abs(), axis=1)
    allowed = np.maximum(1, 0.05 * sizes)
    return dg.AssetCheckResult(
        passed=len(by_split) == 3
        and bool((by_split > 0).all(axis=None))
        and not off.gt(allowed, axis=0).any(axis=None),
        description=f"splits are {off.max(axis=None):.1f} models off equal shares at most",
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
def the_unet_is_sound(unet: TrainedUNet, rotated_splits: pd.DataFrame) -> dg.AssetCheckResult:
    """No weight is infinite or no number, and the U-Net was trained at the masks' resolution."""
    broken = sum(int((~weights.isfinite()).sum()) for weights in unet.weights.values())
    resolution = int(rotated_splits["resolution"].iloc[0])
    return dg.AssetCheckResult(
        passed=not broken and unet.resolution == resolution,
        description=f"{broken} weights are not finite; the U-Net's resolution is "
        f"{unet.resolution}, the masks' {resolution}",
        metadata={"weights_not_finite": broken, "resolution": unet.resolution},
    )


@dg.asset_check(asset="policies", additional_ins={"unet": dg.AssetIn("unet")})
def policies_are_sound(policies: list[UPath], unet: TrainedUNet) -> dg.AssetCheckResult:
    """Every policy was trained with this U-Net, and no weight is infinite or no number."""
    from tactile_core.exploration.policies.store import describe, read_weights

    stored = {directory.name: describe(directory) for directory in policies}
    of_another = [name for name, policy in stored.items() if policy.unet != unet.version()]
    broken = [
        directory.name
        for directory in policies
        if not all(
            weights.isfinite().all()
            for weights in read_weights(directory, stored[directory.name]).values()
        )
    ]
    return dg.AssetCheckResult(
        passed=not of_another and not broken,
        description=f"{len(of_another)} of {len(policies)} policies are of another U-Net, "
        f"{len(broken)} have weights that are not finite",
        metadata={
            "policies": len(policies),
            "of_another_unet": len(of_another),
            "with_weights_not_finite": len(broken),
            "first": first([*of_another, *broken]),
        },
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
    row = table[(table["split"] == "test") & table["touches"].isna()]
    jaccard = float(row["jaccard"].iloc[0])
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


@dg.asset_check(asset="per_step_evaluation")
def trained_policies_beat_random(per_step_evaluation: pd.DataFrame) -> dg.AssetCheckResult:
    """After the last ray every trained policy has a higher mean Jaccard index than `random`."""
    from tactile_core.exploration.policies.references import REFERENCES

    table = per_step_evaluation
    last = table[table["step"] == table["step"].max()]
    means = last.groupby(["policy", "seed"], as_index=False)["jaccard"].mean()
    random = means.loc[means["policy"] == "random", "jaccard"]
    if random.empty:
        return dg.AssetCheckResult(passed=True, description="random was not evaluated")
    bar = float(random.iloc[0])
    trained = means[~means["policy"].isin(REFERENCES)]
    worse = trained[trained["jaccard"] <= bar]
    return dg.AssetCheckResult(
        passed=worse.empty,
        severity=UNLESS_SMOKE,
        description=f"{len(worse)} of {len(trained)} policies do not beat random ({bar:.1f})",
        metadata={
            "policies_below_random": len(worse),
            "jaccard_of_random": number(bar),
            **numbers("jaccard", trained.groupby("policy")["jaccard"].mean()),
        },
    )


@dg.asset_check(asset="per_grasp_evaluation")
def touches_raise_the_jaccard_index(per_grasp_evaluation: pd.DataFrame) -> dg.AssetCheckResult:
    """With all touches held, every policy has a higher mean Jaccard index than with the first."""
    table = per_grasp_evaluation.dropna(subset="jaccard")
    by_grasp = table.groupby(["policy", "grasp"])["jaccard"].mean().unstack()
    raised = by_grasp.iloc[:, -1] - by_grasp.iloc[:, 0]
    lower = raised.index[~(raised > 0)]
    return dg.AssetCheckResult(
        passed=lower.empty,
        severity=UNLESS_SMOKE,
        description=f"{len(lower)} of {len(raised)} policies reconstruct no better at the end",
        metadata={"policies_no_better": len(lower), **numbers("raised_by", raised)},
    )


def first(names: Iterable[str]) -> str:
    """The first few names, for a reader to begin with."""
    return ", ".join(list(names)[:5]) or "none"
