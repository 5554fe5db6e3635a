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
from tactile_core.keys import work_key
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
    rotated_splits: pd.DataFrame,
    previous: pd.DataFrame | None = None,
    progress: Callable[[str], None] = lambda message: None,
) -> pd.DataFrame:
    """The outline of every sample: sample_id, model_id, category, split, outline, mask_hash, key.

    previous : the outlines of an earlier run; masks that it holds are not traced again

    A sample keeps its id when it is rotated otherwise: the hash of its mask tells which one it was.
    """
    table = rotated_splits[["sample_id", "model_id", "category", "split"]].reset_index(drop=True)
    hashes = rotated_splits["mask"].map(content_hash).to_numpy()
    key = work_key("dataset.outlines")
    traced: dict[str, np.ndarray] = {}
    if previous is not None and "key" in previous:
        same = previous[previous["key"] == key]
        traced = dict(zip(same["mask_hash"], same["outline"], strict=True))
    missing = np.array([mask_hash not in traced for mask_hash in hashes], bool)
    masks = (mask for some in decoded(rotated_splits["mask"][missing]) for mask in some)
    told = counted(masks, int(missing.sum()), progress, "outlines traced")
    traced |= {
        mask_hash: outline(mask) for mask_hash, mask in zip(hashes[missing], told, strict=True)
    }
    progress(f"{missing.sum()} outlines traced, {(~missing).sum()} unchanged")
    outlines = pd.Series([traced[mask_hash] for mask_hash in hashes], dtype=object)
    return table.assign(outline=outlines, mask_hash=hashes, key=key)
