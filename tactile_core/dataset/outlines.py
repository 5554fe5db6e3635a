"""Outlines: the pixels of a mask that a ray from outside can reach (report, section IV).

A ray is a line of pixels that may step diagonally, and so slip between two pixels that touch
only at a corner. The outside is therefore all background that such steps reach from the border
of the image, concavities included and holes not, and the outline is every mask pixel one step
away from it: whatever a ray meets first is a pixel of the outline.
"""

from collections.abc import Callable

import numpy as np
import pandas as pd
from scipy import ndimage

from tactile_core.dataset.rendering.pictures import decoded
from tactile_core.files import content_hash
from tactile_core.progress import counted

EIGHT_NEIGHBOURS = np.ones((3, 3), dtype=bool)


def outline(mask: np.ndarray) -> np.ndarray:
    """The outline of a (R, R) bool mask as (K, 2) int16 (row, column), in row-major order."""
    padded = np.pad(mask, 1)
    regions, _ = ndimage.label(~padded, EIGHT_NEIGHBOURS)
    outside = regions == regions[0, 0]
    reached = padded & ndimage.binary_dilation(outside, EIGHT_NEIGHBOURS)
    return np.argwhere(reached[1:-1, 1:-1]).astype(np.int16)


def trace_outlines(
    rotated_splits: pd.DataFrame, progress: Callable[[str], None] = lambda message: None
) -> pd.DataFrame:
    """The outline of every sample: sample_id, model_id, category, split, outline, mask_hash.

    A sample keeps its id when it is rotated otherwise: the hash of its mask tells which one it was.
    """
    table = rotated_splits[["sample_id", "model_id", "category", "split"]].reset_index(drop=True)
    masks = (mask for some in decoded(rotated_splits["mask"]) for mask in some)
    outlines = [outline(mask) for mask in counted(masks, len(table), progress, "outlines traced")]
    hashes = rotated_splits["mask"].map(content_hash).to_numpy()
    return table.assign(outline=pd.Series(outlines, dtype=object), mask_hash=hashes)
