"""Touches: points drawn from an outline, and the image that shows them (report, section IV)."""

from collections.abc import Callable, Sequence

import numpy as np
import pandas as pd

from tactile_core.dataset.seeds import generator
from tactile_core.dataset.shapes import as_points
from tactile_core.errors import TactileError
from tactile_core.progress import counted
from tactile_core.settings import TouchSettings


def sample_touches(
    outlines: pd.DataFrame,
    settings: TouchSettings,
    progress: Callable[[str], None] = lambda message: None,
) -> pd.DataFrame:
    """`sets_per_mask` touch sets of each outline.

    The columns are sample_id, model_id, category, split, set and touches. A set has `fewest`
    to `most` different points, each number equally likely, and never more than the outline
    has. It depends on the seed and its sample only.
    """
    sets, touches = [], []
    cells = zip(outlines["sample_id"], outlines["outline"], strict=True)
    for sample, cell in counted(cells, len(outlines), progress, "outlines touched"):
        points = as_points(cell)
        random = generator(settings.seed, sample)
        for number in range(settings.sets_per_mask):
            count = int(random.integers(settings.fewest, settings.most, endpoint=True))
            chosen = random.choice(len(points), min(count, len(points)), replace=False)
            sets.append(number)
            touches.append(points[chosen])
    rows = np.repeat(np.arange(len(outlines)), settings.sets_per_mask)
    table = outlines[["sample_id", "model_id", "category", "split"]].iloc[rows]
    return table.reset_index(drop=True).assign(set=sets, touches=pd.Series(touches, dtype=object))


def differ_and_lie_on(touches: np.ndarray, outline: np.ndarray) -> bool:
    """Whether touches (k, 2) are all different, and pixels of an outline (K, 2)."""
    numbers = pixel_numbers(as_points(touches))
    on_it = np.isin(numbers, pixel_numbers(as_points(outline)))
    return bool(on_it.all()) and len(np.unique(numbers)) == len(numbers)


def pixel_numbers(points: np.ndarray) -> np.ndarray:
    """A number (k,) for each of (k, 2) int16 points, the same for the same pixel."""
    return points[:, 0].astype(np.int32) * 2**16 + points[:, 1]


def rasterise_touches(touches: Sequence[np.ndarray], resolution: int) -> np.ndarray:
    """N sets of (k, 2) touches as (N, R, R) bool images, True where a touch is."""
    images = np.zeros((len(touches), resolution, resolution), dtype=bool)
    if len(touches) == 0:
        return images
    image = np.repeat(np.arange(len(touches)), [len(points) for points in touches])
    row, column = np.concatenate([as_points(points) for points in touches]).T
    if row.size and (
        min(row.min(), column.min()) < 0 or max(row.max(), column.max()) >= resolution
    ):
        raise TactileError(
            f"touches lie outside a {resolution}×{resolution} image: they come from masks of "
            "another resolution"
        )
    images[image, row, column] = True
    return images
