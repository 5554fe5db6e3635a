"""The stored touch sets: Table II is measured on them, and the report trains with them (V)."""

import numpy as np
import pandas as pd

from tactile_core.dataset.shapes import Shapes, as_points
from tactile_core.dataset.touches import pixel_numbers
from tactile_core.errors import TactileError
from tactile_core.files import content_hash
from tactile_core.reconstruction.batches import TouchSource, touch_images


def touch_sets_of(
    shapes: Shapes, tactile_samples: pd.DataFrame
) -> tuple[np.ndarray, list[np.ndarray]]:
    """The stored touch sets of `shapes`: indices of their shapes (S,), and S arrays (k, 2).

    Raises `TactileError` where they are those of other outlines.
    """
    index = {sample: position for position, sample in enumerate(shapes.sample_ids)}
    rows = tactile_samples[tactile_samples["sample_id"].isin(index.keys())]
    indices = np.array([index[sample] for sample in rows["sample_id"]], int)
    sets = [as_points(touches) for touches in rows["touches"]]
    for number, touches in zip(indices, sets, strict=True):
        if not np.isin(pixel_numbers(touches), pixel_numbers(shapes.outlines[number])).all():
            raise TactileError(
                f"touches of {shapes.sample_ids[number]} lie off its outline: materialise "
                "tactile_samples again"
            )
    return indices, sets


def stored_touches(shapes: Shapes, tactile_samples: pd.DataFrame) -> TouchSource:
    """Draws, for each shape, one of its stored touch sets.

    Raises `TactileError` where a shape has none, or its own are those of another outline.
    """
    owners, sets = touch_sets_of(shapes, tactile_samples)
    counts = np.bincount(owners, minlength=len(shapes))
    if not counts.all():
        raise TactileError(
            f"{(counts == 0).sum()} samples have no touch set (first: "
            f"{shapes.sample_ids[int(counts.argmin())]}): materialise tactile_samples again"
        )
    lengths = np.array([len(touches) for touches in sets])
    points = np.zeros((len(sets), lengths.max(), 2), np.int16)
    for row, touches in zip(points, sets, strict=True):
        row[: len(touches)] = touches
    by_owner = np.argsort(owners, kind="stable")
    firsts = np.cumsum(counts) - counts  # of each shape, in the order of `by_owner`

    def draw(rng: np.random.Generator, indices: np.ndarray) -> np.ndarray:
        chosen = by_owner[firsts[indices] + rng.integers(counts[indices])]  # (B,)
        held = np.arange(points.shape[1]) < lengths[chosen, None]
        return touch_images(points[chosen], held, shapes.resolution)

    return TouchSource(draw, content_hash(owners.tobytes(), lengths.tobytes(), points.tobytes()))
