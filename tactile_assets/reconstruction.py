"""Report, section V: a U-Net that completes a shape from a few touches."""

import time
from pathlib import Path

import dagster as dg
import pandas as pd
from upath import UPath

from tactile_assets import columns
from tactile_assets.automation import after
from tactile_assets.code_versions import code_version
from tactile_assets.config import PROFILE, StageConfig, defaults
from tactile_assets.io_managers import TrainedUNet, UNetsBySeed
from tactile_assets.metadata import (
    curves_at,
    number,
    numbers,
    renewed,
    seconds_since,
    shown,
    stored,
    wing,
)
from tactile_assets.resources import Store
from tactile_core.parquet import read_table
from tactile_core.settings import PracticeSettings, SearchSettings, UNetSettings

UNET_CODE = "reconstruction.training", "reconstruction.unets", "exploration.practice.ray_touches"
UNETS = {"unets": dg.AssetIn("unet")}  # for whoever goes with each of them
OF_EACH_SEED = {
    "seed": columns.RECONSTRUCTION["seed"],
    "epoch": "That of the lowest eval loss, whose weights are kept.",
    "eval_loss": columns.RECONSTRUCTION["loss"],
    "eval_jaccard": columns.RECONSTRUCTION["jaccard"],
}


@defaults(PROFILE.search)
class SearchConfig(StageConfig, SearchSettings):
    """BOHB search over the U-Net's hyperparameters."""


@defaults(PROFILE.practice or PracticeSettings())
class PracticeConfig(StageConfig, PracticeSettings):
    """A first U-Net and a ray scorer, whose rays the final U-Net learns from as well."""


@defaults(PROFILE.unet)
class UNetConfig(StageConfig, UNetSettings):
    """The final training of the U-Net."""


@dg.asset(
    kinds={"ray", "pytorch", "parquet"},
    code_version=code_version(
        "reconstruction.search", "exploration.practice.ray_touches", PROFILE.search
    ),
    **wing("reconstruction"),
)
def unet_search(
    context: dg.AssetExecutionContext,
    config: SearchConfig,
    store: Store,
    rotated_splits: pd.DataFrame,
    outlines: pd.DataFrame,
    tactile_samples: pd.DataFrame,
) -> dg.MaterializeResult:
    """Every trial of the search for the U-Net's learning rate, batch size, depth and channels.

    Ray Tune lets Bayesian optimisation suggest settings and HyperBand stop the poor ones early
    (BOHB, Table I). `RAY_ADDRESS` names a running cluster; unset, a local Ray starts for the
    search. Loss and Jaccard index are those on the eval split.
    """
    from tactile_core.dataset.shapes import load_shapes
    from tactile_core.exploration.practice.ray_touches import touch_source
    from tactile_core.figures.curves import search_scatter
    from tactile_core.figures.style import png
    from tactile_core.reconstruction.search import search_unet

    began = time.perf_counter()
    train = load_shapes(rotated_splits, outlines, "train")
    table = search_unet(
        train,
        load_shapes(rotated_splits, outlines, "eval"),
        SearchSettings(**config.model_dump()),  # Ray's workers know nothing of Dagster
        touches=touch_source(config.touches, train, tactile_samples, seed=config.seed),
        previous=store.previous("unet_search"),
        work=store.far_work("unet_search"),
        token=Path(store.home, "ray-token"),
        progress=context.log.info,
    )
    return stored(
        table,
        columns.TRIALS,
        loss_of_each_trial=store.picture("unet_search.png", png(search_scatter(table))),
        best_trials=shown(table.head(10).drop(columns="key"), columns.TRIALS),
        trials=len(table),
        best_jaccard=number(table["jaccard"].iloc[0]),
        best_loss=number(table["loss"].iloc[0]),
        seconds=seconds_since(began),
    )


@dg.asset(
    kinds={"pytorch", "parquet"},
    code_version=code_version("exploration.practice.practice", PROFILE.practice),
    **wing("reconstruction"),
)
def practice_rays(
    context: dg.AssetExecutionContext,
    config: PracticeConfig,
    store: Store,
    rotated_splits: pd.DataFrame,
    outlines: pd.DataFrame,
    unet_search: pd.DataFrame,
) -> dg.MaterializeResult:
    """What the rays of a first, learned policy feel, for the final U-Net to learn from.

    A U-Net meets the touches that policies make, and those are neither uniform nor random. So a
    first U-Net is trained, then a ray scorer on it, and its rays and those of `coverage` on every
    train sample are recorded, with a share of other rays among them.
    """
    from tactile_core.dataset.shapes import load_shapes
    from tactile_core.exploration.practice.practice import practise
    from tactile_core.reconstruction.hyperparameters import with_best_trial
    from tactile_core.spread import LARGE_TRAINING, handed_over

    began = time.perf_counter()
    settings = with_best_trial(config, unet_search)
    previous = store.previous("practice_rays")
    table = handed_over(
        practise,
        load_shapes(rotated_splits, outlines, "train"),
        load_shapes(rotated_splits, outlines, "eval"),
        PracticeSettings(**settings.model_dump()),
        work=store.far_work("practice_rays"),
        previous=previous,
        needs=LARGE_TRAINING,
        progress=context.log.info,
    )
    missed = table["touches"].map(lambda touches: (touches[:, 0] < 0).mean())
    runs = (
        table.assign(missed=100 * missed)
        .groupby("sequence")
        .agg(
            policy=("policy", "first"),
            strays=("strays", "first"),
            missed_percent=("missed", "mean"),
        )
    )
    return stored(
        table,
        columns.PRACTICE,
        runs_of_rays=shown(runs.reset_index()),
        sequences=len(table),
        **renewed(table, previous),
        seconds=seconds_since(began),
    )


@dg.asset(
    kinds={"pytorch", "safetensors"},
    code_version=code_version(*UNET_CODE, PROFILE.unet),
    deps=["practice_rays"] if PROFILE.practice else [],
    **wing("reconstruction", "unets"),
)
def unet(
    context: dg.AssetExecutionContext,
    config: UNetConfig,
    store: Store,
    rotated_splits: pd.DataFrame,
    outlines: pd.DataFrame,
    tactile_samples: pd.DataFrame,
    unet_search: pd.DataFrame,
) -> dg.MaterializeResult:
    """The reconstruction net: an image of 1 to 10 touches in, a probability per pixel out.

    A U-Net with the best settings of the search, trained to the end with early stopping on the
    eval split. `touches` says what it learns from: the stored sets, as in the report; fresh draws
    from the outlines; or those for one half, and for the other what rays feel. With `free_space` it
    also sees where rays have passed; with `known_shapes` the mean of the train shapes that agree
    with what was felt; and where there are `practice_rays`, a third of what it learns from is
    theirs. With `further_seeds` one more is trained for each, so that tables hold for more than one
    training of it. A training that was killed goes on after its last epoch.
    """
    from tactile_core.dataset.shapes import load_shapes
    from tactile_core.exploration.practice.ray_touches import practised, touch_source
    from tactile_core.figures.curves import learning_curve
    from tactile_core.figures.style import png
    from tactile_core.reconstruction.hyperparameters import with_best_trial
    from tactile_core.reconstruction.trained import unet_at
    from tactile_core.reconstruction.training import train_unet
    from tactile_core.reconstruction.unets import first_of, places_of, settings_of_each, version_of
    from tactile_core.spread import LARGE_TRAINING, handed_over

    began = time.perf_counter()
    train = load_shapes(rotated_splits, outlines, "train")
    eval_shapes = load_shapes(rotated_splits, outlines, "eval")
    chosen = UNetSettings(**with_best_trial(config, unet_search).model_dump())
    practice = None
    if PROFILE.practice:
        practice = practised(read_table(store.path("practice_rays.parquet")), train)
    each = {settings.seed: settings for settings in settings_of_each(chosen)}
    places = places_of(each, store.path("unet"))
    work = places_of(each, UPath(store.far_work("unet")))
    unets: UNetsBySeed = {}
    for seed, settings in each.items():
        if len(each) > 1:
            context.log.info(f"U-Net: seed {seed}, {len(unets) + 1} of {len(each)}")
        unets[seed] = handed_over(
            train_unet,
            train,
            eval_shapes,
            settings,
            work=work[seed],
            needs=LARGE_TRAINING,
            touches=touch_source(
                settings.touches, train, tactile_samples,
                seed=seed, free_space=settings.free_space, practice=practice,
            ),
            previous=unet_at(places[seed]),
            progress=context.log.info,
        )  # fmt: skip
    scores = pd.DataFrame({seed: unet.scores for seed, unet in unets.items()}).T
    one = first_of(unets)
    return dg.MaterializeResult(
        value=unets,
        data_version=dg.DataVersion(version_of(unets)),
        metadata={
            "learning_curve": store.picture("learning_curve.png", png(learning_curve(one.curve))),
            "eval_jaccard": number(scores["eval_jaccard"].mean()),
            "eval_loss": number(scores["eval_loss"].mean()),
            "best_epoch": int(one.scores["epoch"]),
            "parameters": sum(weights.numel() for weights in one.weights.values()),
            "of_each_seed": shown(scores.rename_axis("seed").reset_index(), OF_EACH_SEED),
            "seconds": seconds_since(began),
            "settings": dg.MetadataValue.json(one.settings),
            **curves_at(store.far_work("unet") / "tensorboard"),
        },
    )


@dg.asset(
    kinds={"pytorch", "parquet"},
    code_version=code_version("reconstruction.scores", "reconstruction.unets", "evaluation.unseen"),
    automation_condition=after("unet"),
    ins=UNETS,
    **wing("reconstruction"),
)
def reconstruction_evaluation(
    context: dg.AssetExecutionContext,
    store: Store,
    rotated_splits: pd.DataFrame,
    outlines: pd.DataFrame,
    tactile_samples: pd.DataFrame,
    unets: UNetsBySeed,
) -> dg.MaterializeResult:
    """How well the U-Net reconstructs: Table II, and the Jaccard index for 0 to 10 touches.

    Loss and Jaccard index on train, eval and test. Rows without a number of touches are over
    the stored touch sets, as in Table II. Of several U-Nets each has its rows, and pictures and
    numbers are of their mean.
    """
    from tactile_core.dataset.shapes import SPLITS, load_shapes
    from tactile_core.evaluation.tables import reconstruction_rows
    from tactile_core.evaluation.unseen import refuse_known
    from tactile_core.figures.curves import touches_curve
    from tactile_core.figures.style import png
    from tactile_core.reconstruction.scores import evaluate_reconstruction
    from tactile_core.reconstruction.unets import first_of

    shapes = {split: load_shapes(rotated_splits, outlines, split) for split in SPLITS}
    refuse_known(
        shapes["test"], seen_by(unets), by_name=True,
        remedy="the splits have been dealt anew since, materialise unet again",
    )  # fmt: skip
    began = time.perf_counter()
    previous = store.previous("reconstruction_evaluation")
    table = pd.concat(
        [
            evaluate_reconstruction(
                unet, shapes, tactile_samples, previous=previous, progress=context.log.info
            ).assign(seed=seed)
            for seed, unet in unets.items()
        ],
        ignore_index=True,
    )
    seconds = time.perf_counter() - began
    mixed = table[table["touches"].isna()]
    mix = mixed.groupby("split", sort=False)[["loss", "jaccard"]].mean()
    made = renewed(table, previous)
    rate = {} if made["kept"] else {"samples_a_second": number(table["samples"].sum() / seconds)}
    return stored(
        table,
        columns.RECONSTRUCTION,
        good_median_and_bad_reconstructions=store.picture(
            "reconstructions.png",
            examples(first_of(unets), rotated_splits, outlines, tactile_samples),
        ),
        table_ii=shown(reconstruction_rows(table)),
        jaccard_by_number_of_touches=store.picture("reconstruction.png", png(touches_curve(table))),
        **numbers("jaccard", mix["jaccard"]),
        **numbers("loss", mix["loss"]),
        **made,
        **rate,
        seconds=number(seconds),
    )


def seen_by(unets: UNetsBySeed) -> dict[str, pd.DataFrame]:
    """The models that each U-Net was trained on."""
    return {f"the U-Net of seed {seed}": unet.trained_on for seed, unet in unets.items()}


def examples(
    unet: TrainedUNet,
    rotated_splits: pd.DataFrame,
    outlines: pd.DataFrame,
    tactile_samples: pd.DataFrame,
) -> bytes:
    """Good, median and bad reconstructions of the test split, as PNG bytes."""
    from tactile_core.dataset.shapes import load_shapes
    from tactile_core.dataset.touches import rasterise_touches
    from tactile_core.figures.sheets import reconstruction_sheet
    from tactile_core.figures.style import png
    from tactile_core.reconstruction.inference import Reconstructor
    from tactile_core.reconstruction.jaccard import jaccard_index
    from tactile_core.reconstruction.scores import touch_sets_of

    test = load_shapes(rotated_splits, outlines, "test")
    indices, touches = touch_sets_of(test, tactile_samples)
    masks = test.packed[indices]
    predictions = Reconstructor(unet).predict(rasterise_touches(touches, test.resolution))
    scores = jaccard_index(predictions, masks)
    return png(reconstruction_sheet(touches, predictions, masks, scores))
