"""Report, section V: a U-Net that completes a shape from a few touches."""

import dagster as dg
import pandas as pd

from tactile_assets.automation import after
from tactile_assets.code_versions import code_version
from tactile_assets.config import PROFILE, StageConfig, defaults
from tactile_assets.io_managers import TrainedUNet
from tactile_assets.metadata import markdown, stored, wing
from tactile_assets.resources import Store
from tactile_core.settings import SearchSettings, UNetSettings


@defaults(PROFILE.search)
class SearchConfig(StageConfig, SearchSettings):
    """BOHB search over the U-Net's hyperparameters."""


@defaults(PROFILE.unet)
class UNetConfig(StageConfig, UNetSettings):
    """The final training of the U-Net."""


@dg.asset(
    kinds={"ray", "pytorch", "parquet"},
    code_version=code_version("reconstruction.search", PROFILE.search),
    deps=["tactile_samples"],  # for its check: it draws touches of its own from the same outlines
    **wing("reconstruction"),
)
def unet_search(
    context: dg.AssetExecutionContext,
    config: SearchConfig,
    store: Store,
    rotated_splits: pd.DataFrame,
    outlines: pd.DataFrame,
) -> dg.MaterializeResult:
    """Every trial of the search for the U-Net's learning rate, batch size, depth and channels.

    Ray Tune lets Bayesian optimisation suggest settings and HyperBand stop the poor ones early
    (BOHB, Table I). `RAY_ADDRESS` names a running cluster; unset, a local Ray starts for the
    search. Loss and Jaccard index are those on the eval split.
    """
    from tactile_core.dataset.shapes import load_shapes
    from tactile_core.figures.curves import search_scatter
    from tactile_core.figures.style import png
    from tactile_core.reconstruction.search import search_unet

    table = search_unet(
        load_shapes(rotated_splits, outlines, "train"),
        load_shapes(rotated_splits, outlines, "eval"),
        SearchSettings(**config.model_dump()),  # Ray's workers know nothing of Dagster
        work=store.work("unet_search"),
        progress=context.log.info,
    )
    return stored(
        table,
        trials=len(table),
        best_jaccard=round(float(table["jaccard"].iloc[0]), 2),
        best_trials=markdown(table.head(10), digits=4),
        trials_drawn=store.picture("unet_search.png", png(search_scatter(table))),
    )


@dg.asset(
    kinds={"pytorch", "safetensors"},
    code_version=code_version(
        "reconstruction.training", "exploration.practice.practice", PROFILE.unet
    ),
    **wing("reconstruction", "unets"),
)
def unet(
    context: dg.AssetExecutionContext,
    config: UNetConfig,
    store: Store,
    rotated_splits: pd.DataFrame,
    outlines: pd.DataFrame,
    unet_search: pd.DataFrame,
) -> dg.MaterializeResult:
    """The reconstruction net: an image of 1 to 10 touches in, a probability per pixel out.

    A U-Net with the best settings of the search, trained to the end on touches that are drawn
    afresh all the time, half of them from the outline and half as rays make them, with early
    stopping on the eval split. With `free_space` it also sees where rays have passed; with
    `known_shapes` the mean of the train shapes that agree with what was felt; with `practice` it
    also learns from the rays of a first policy. A training that was killed goes on after its last
    epoch.
    """
    from tactile_core.dataset.shapes import load_shapes
    from tactile_core.exploration.practice.practice import practise
    from tactile_core.exploration.practice.ray_touches import rays_and_outlines
    from tactile_core.figures.curves import learning_curve
    from tactile_core.figures.style import png
    from tactile_core.reconstruction.search import with_best_trial
    from tactile_core.reconstruction.training import train_unet

    work = store.work("unet")
    train = load_shapes(rotated_splits, outlines, "train")
    evaluation = load_shapes(rotated_splits, outlines, "eval")
    settings = with_best_trial(config, unet_search)
    report = context.log.info
    practice = None
    if settings.practice:
        practice = practise(train, evaluation, settings, work=work / "practice", progress=report)
    draw = rays_and_outlines(train, settings.seed, settings.free_space, practice)
    trained = train_unet(train, evaluation, settings, work=work, draw=draw, progress=report)
    return dg.MaterializeResult(
        value=trained,
        data_version=dg.DataVersion(trained.version()),
        metadata={
            **{name: round(score, 4) for name, score in trained.scores.items()},
            "parameters": sum(weights.numel() for weights in trained.weights.values()),
            "settings": dg.MetadataValue.json(trained.settings),
            "tensorboard": dg.MetadataValue.path(work / "tensorboard"),
            "learning_curve": store.picture(
                "learning_curve.png", png(learning_curve(trained.curve))
            ),
        },
    )


@dg.asset(
    kinds={"pytorch", "parquet"},
    code_version=code_version("reconstruction.scores"),
    automation_condition=after("unet"),
    **wing("reconstruction"),
)
def reconstruction_evaluation(
    context: dg.AssetExecutionContext,
    store: Store,
    rotated_splits: pd.DataFrame,
    outlines: pd.DataFrame,
    tactile_samples: pd.DataFrame,
    unet: TrainedUNet,
) -> dg.MaterializeResult:
    """How well the U-Net reconstructs: Table II, and the Jaccard index for 0 to 10 touches.

    Loss and Jaccard index on train, eval and test. Rows without a number of touches are over
    the stored touch sets, as in Table II.
    """
    from tactile_core.dataset.shapes import SPLITS, load_shapes
    from tactile_core.evaluation.tables import reconstruction_rows
    from tactile_core.figures.curves import touches_curve
    from tactile_core.figures.style import png
    from tactile_core.reconstruction.scores import evaluate_reconstruction

    shapes = {split: load_shapes(rotated_splits, outlines, split) for split in SPLITS}
    table = evaluate_reconstruction(unet, shapes, tactile_samples, progress=context.log.info)
    return stored(
        table,
        table_ii=markdown(reconstruction_rows(table)),
        by_touches=store.picture("reconstruction.png", png(touches_curve(table))),
        examples=store.picture(
            "reconstructions.png", examples(unet, rotated_splits, outlines, tactile_samples)
        ),
    )


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
    masks = test.masks[indices]
    predictions = Reconstructor(unet).predict(rasterise_touches(touches, test.resolution))
    scores = jaccard_index(predictions, masks)
    return png(reconstruction_sheet(touches, predictions, masks, scores))
