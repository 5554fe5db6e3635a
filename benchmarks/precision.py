"""Do bfloat16 and eight bits change the science? Jaccard indices of the same touches in each."""

from collections.abc import Callable

import numpy as np
import pandas as pd

from benchmarks.samples import CHANNELS, DEPTH, RESOLUTION, as_trained, meshes, shapes
from benchmarks.timing import Pace, Row
from tactile_core.dataset.rendering.camera import project
from tactile_core.dataset.rendering.rasteriser import rasterise
from tactile_core.dataset.shapes import Shapes, load_shapes
from tactile_core.dataset.touches import rasterise_touches
from tactile_core.errors import TactileError
from tactile_core.exploration.policies.references import find_reference
from tactile_core.exploration.world.rays import RAYS
from tactile_core.exploration.world.state import Explorations
from tactile_core.parquet import read_table
from tactile_core.reconstruction.batches import draw_touch_sets
from tactile_core.reconstruction.engines import Precision
from tactile_core.reconstruction.epoch import begin_training, train_epoch
from tactile_core.reconstruction.inference import Reconstructor, best_device, bfloat16_pays
from tactile_core.reconstruction.jaccard import jaccard_index
from tactile_core.reconstruction.trained import TrainedUNet, load_unet

GOAL = 0.1  # points of the Jaccard index
ROUGH: tuple[Precision, ...] = ("bfloat16", "int8")  # what is compared with float32
TOUCH_SETS = 5  # for each test shape
MODELS, ROTATIONS, EPOCHS = 50, 3, 40  # each class, each model; about 15 seconds of training


def precision_pairs(pace: Pace, progress: Callable[[str], None]) -> tuple[pd.DataFrame, str]:
    """One row for each touch image: touches (how they were made), float32, and bfloat16 or int8 or
    both (Jaccard indices): what this machine can run in.

    And which U-Net it was.
    """
    unet, test, whose = trained_and_test(pace, progress)
    exact = Reconstructor(unet, "float32")
    device = best_device().type
    there = {"bfloat16": device != "cpu" or bfloat16_pays(device), "int8": device == "cpu"}
    rough = [name for name in ROUGH if there[name]]
    precisions = {"float32": exact} | {name: Reconstructor(unet, name) for name in rough}
    tables = []
    for name, images in {
        "sets of 1 to 10 touches": uniform_touches(test),
        "touches of 1 to 10 rays": touches_of_rays(test, exact),
    }.items():
        wanted = np.concatenate([test.masks] * (len(images) // len(test)))
        scores = {
            precision: jaccard_index(reconstructor.predict(images), wanted)
            for precision, reconstructor in precisions.items()
        }
        tables.append(pd.DataFrame({"touches": name, **scores}))
    return pd.concat(tables, ignore_index=True), whose


def precision_rows(pairs: pd.DataFrame) -> list[Row]:
    """Mean Jaccard indices of each precision beside float32."""
    return [
        Row(
            f"Jaccard index, {precision} beside float32, {name}",
            some[precision].mean(), some["float32"].mean(), "points",
            some[precision].mean() / some["float32"].mean(), f"difference < {GOAL}",
            bool(abs(some[precision].mean() - some["float32"].mean()) < GOAL),
        )
        for precision in roughs(pairs)
        for name, some in pairs.groupby("touches")
    ]  # fmt: skip


def pair_summary(pairs: pd.DataFrame) -> pd.DataFrame:
    """How far the two Jaccard indices of one touch image lie apart, in points."""
    tables = []
    for precision in roughs(pairs):
        gaps = (pairs[precision] - pairs["float32"]).groupby(pairs["touches"])
        sizes = (pairs[precision] - pairs["float32"]).abs().groupby(pairs["touches"])
        summary = {
            "pairs": gaps.size(),
            "mean difference": gaps.mean(),
            "mean of its size": sizes.mean(),
            "95 % below": sizes.quantile(0.95),
            "largest": sizes.max(),
        }
        tables.append(pd.DataFrame(summary).reset_index().assign(precision=precision))
    return pd.concat(tables, ignore_index=True)


def roughs(pairs: pd.DataFrame) -> list[str]:
    return [name for name in ROUGH if name in pairs]


def uniform_touches(test: Shapes) -> np.ndarray:
    """Uniform touch sets on each outline, as images (5 · N, R, R)."""
    sets = [
        touches
        for seed in range(TOUCH_SETS)
        for touches in draw_touch_sets(test, np.random.default_rng(seed))
    ]
    return rasterise_touches(sets, test.resolution).astype(np.int8)


def touches_of_rays(test: Shapes, reconstructor: Reconstructor) -> np.ndarray:
    """What each of ten rays of `even` left felt, as the U-Net sees it, (10 · N, R, R) int8."""
    policy = find_reference("even")
    explorations = Explorations(test.masks, reconstructor)
    images = []
    for _ in range(RAYS):
        explorations.cast(policy.choose(explorations, np.random.default_rng(0)))
        images.append(explorations.felt())
    return np.concatenate(images)


def trained_and_test(
    pace: Pace, progress: Callable[[str], None]
) -> tuple[TrainedUNet, Shapes, str]:
    """A trained U-Net, test shapes and whose they are: the platform's own where it holds them."""
    if not pace.quick:
        try:
            unet, test = from_platform()
            return unet, test, f"the platform's, {unet.version()}"
        except TactileError as error:
            progress(f"a U-Net is trained on generated shapes to compare precisions: {error}")
    return *short_training(pace), "trained for some seconds on generated shapes"


def from_platform() -> tuple[TrainedUNet, Shapes]:
    """The U-Net and the test split among the artifacts; `TactileError` where they are not, or it
    cannot run in all precisions."""
    from tactile_assets.resources import Store

    store = Store.from_environment()
    unet = load_unet(store.path("unet"))
    if not unet.eight_bits:
        raise TactileError("the platform's U-Net is too small, or too old, for eight bits")
    test = load_shapes(
        read_table(store.path("rotated_splits.parquet")),
        read_table(store.path("outlines.parquet")),
        "test",
    )
    if unet.resolution != test.resolution:
        raise TactileError("unet and rotated_splits are of different resolutions")
    return unet, test


def short_training(pace: Pace) -> tuple[TrainedUNet, Shapes]:
    """A U-Net trained on most of some generated shapes, and the shapes of the other models."""
    rng = np.random.default_rng(0)
    all_meshes = meshes(4 if pace.quick else MODELS)
    drawn = np.stack(
        [
            rasterise(project(mesh.vertices, angle, RESOLUTION), mesh.faces, RESOLUTION)
            for mesh in all_meshes
            for angle in rng.uniform(0, 360, ROTATIONS)
        ]
    )
    held_out = (np.arange(len(drawn)) // ROTATIONS) % 5 == 0
    train, test = shapes(drawn[~held_out]), shapes(drawn[held_out])
    training = begin_training(DEPTH, CHANNELS, learning_rate=2e-3, seed=0)
    for _ in range(EPOCHS):
        train_epoch(training, train, batch_size=16)
    return as_trained(training.net, train), test
