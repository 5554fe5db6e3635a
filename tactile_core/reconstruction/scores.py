"""How well the U-Net reconstructs: the report's Table II, and Jaccard by number of touches."""

from collections.abc import Callable, Iterator, Mapping

import numpy as np
import pandas as pd

from tactile_core.dataset.packed import PackedMasks
from tactile_core.dataset.shapes import Shapes
from tactile_core.files import content_hash
from tactile_core.keys import work_key
from tactile_core.progress import teller
from tactile_core.reconstruction.batches import draw_touch_sets, felt_outlines
from tactile_core.reconstruction.epoch import begin_training, train_epoch
from tactile_core.reconstruction.inference import best_device
from tactile_core.reconstruction.jaccard import jaccard_index
from tactile_core.reconstruction.stored_touches import touch_sets_of
from tactile_core.reconstruction.trained import TrainedUNet
from tactile_core.reconstruction.training import evaluate
from tactile_core.reconstruction.unet import on_device

OVERFIT_TOUCHES = 60
COLUMNS = ["split", "touches", "loss", "jaccard", "samples", "key"]


def evaluate_reconstruction(
    unet: TrainedUNet,
    shapes: Mapping[str, Shapes],
    tactile_samples: pd.DataFrame,
    *,
    most: int = 10,
    seed: int = 0,
    previous: pd.DataFrame | None = None,
    progress: Callable[[str], None] = lambda message: None,
) -> pd.DataFrame:
    """Rows (split, touches, loss, jaccard 0–100, samples, key) for each split of `shapes`.

    A row with empty `touches` is over the stored touch sets (Table II); the others hold
    exactly 0…`most` touches, drawn afresh from each outline. A U-Net that knows shapes does
    not recall those of the very model that it reconstructs: on the train split it could.
    A split whose rows in `previous` have the same key is taken from there.
    """
    tables = []
    for split, some in shapes.items():
        indices, sets = touch_sets_of(some, tactile_samples)
        key = work_key(
            "reconstruction.scores",
            settings={"split": split, "most": most}, seed=seed,
            unet=unet.version(), shapes=some.version,
            touches=content_hash(indices.tobytes(), *(touches.tobytes() for touches in sets)),
        )  # fmt: skip
        if previous is not None and (previous.get("key", pd.Series()) == key).any():
            table = previous[previous["key"] == key]
        else:
            rows = split_rows(unet, split, some, (indices, sets), most, seed, progress)
            table = pd.DataFrame(rows, columns=["touches", "loss", "jaccard", "samples"])
            table = table.assign(split=split, key=key).astype({"touches": "Int64"})
        tables.append(table[COLUMNS])
    return pd.concat(tables, ignore_index=True)


def split_rows(
    unet: TrainedUNet,
    split: str,
    shapes: Shapes,
    stored: tuple[np.ndarray, list[np.ndarray]],
    most: int,
    seed: int,
    progress: Callable[[str], None],
) -> Iterator[tuple[int | None, float, float, int]]:
    """(touches, loss, jaccard, samples) over the `stored` touch sets and for 0…`most` touches."""
    device = best_device()
    recalls_own = split == "train" and unet.known is not None
    net = on_device(unet.net(shapes if recalls_own else None), device)
    models = shapes.model_ids if recalls_own else None
    indices, sets = stored
    loss, scores = evaluate(net, sets, shapes.packed, device, models, indices)
    yield None, loss, float(scores.mean()), len(scores)
    tell = teller(progress, most)
    for touches in range(most + 1):
        rng = np.random.default_rng([seed, touches])
        sets = draw_touch_sets(shapes, rng, fewest=touches, most=touches)
        loss, scores = evaluate(net, sets, shapes.packed, device, models)
        yield touches, loss, float(scores.mean()), len(scores)
        tell(touches, f"{split} split, {touches} touches: Jaccard {scores.mean():.1f}")


def mean_shape_jaccard(train: Shapes, test: Shapes) -> float:
    """Mean Jaccard index over `test` of always predicting the train masks' mean shape.

    What a reconstruction that ignores its touches can reach at best: a U-Net must beat it.
    The mean is thresholded where it scores best on the train masks themselves.
    """
    mean = sum(masks.sum(axis=0) for masks in train.packed.portions()) / len(train)
    levels = np.linspace(0.05, 0.95, 19)
    on_train = [mean_jaccard(mean > level, train.packed) for level in levels]
    return mean_jaccard(mean > levels[int(np.argmax(on_train))], test.packed)


def mean_jaccard(prediction: np.ndarray, masks: PackedMasks) -> float:
    """Mean Jaccard index of one prediction (R, R) on all of the masks."""
    scores = [jaccard_index(prediction, some) for some in masks.portions()]
    return float(np.concatenate(scores).mean())


def overfit_jaccard(train: Shapes, *, shapes: int = 6, epochs: int = 200, seed: int = 0) -> float:
    """Jaccard index (0–100) of a small U-Net trained on a handful of shapes at 60 touches.

    The report's sanity step before the search (section V): a net that cannot learn these by
    heart is broken, whatever its hyperparameters.
    """
    chosen = np.random.default_rng(seed).choice(len(train), min(shapes, len(train)), replace=False)
    few = train.select(chosen)
    training = begin_training(
        depth_for(train.resolution), channels=8, learning_rate=5e-3, seed=seed
    )
    draw = felt_outlines(few, OVERFIT_TOUCHES, OVERFIT_TOUCHES)
    for _ in range(epochs):
        train_epoch(training, few, len(few), draw)
    sets = draw_touch_sets(few, np.random.default_rng(seed), OVERFIT_TOUCHES, OVERFIT_TOUCHES)
    _, scores = evaluate(training.net, sets, few.packed, training.device)
    return float(scores.mean())


def depth_for(resolution: int) -> int:
    """The depth at which a U-Net's lowest level sees as much of a shape as at 64×64 with three, or
    the next smaller one by which its window, the middle half, can be halved."""
    wanted = 3 + max(0, round(np.log2(resolution / 64)))
    return max((d for d in range(3, wanted + 1) if resolution // 2 % 2 ** (d - 1) == 0), default=3)
