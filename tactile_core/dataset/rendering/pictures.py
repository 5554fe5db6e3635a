"""Masks as 1-bit PNG bytes, the form in which tables hold them."""

import io
from collections.abc import Iterable, Iterator

import numpy as np
import pandas as pd
from PIL import Image

from tactile_core.errors import TactileError

AT_A_TIME = 256  # masks that are unpacked together where all of them are gone through


def encode_mask(mask: np.ndarray) -> bytes:
    """A (R, R) bool mask as the bytes of a 1-bit PNG."""
    file = io.BytesIO()
    Image.fromarray(mask).convert("1", dither=Image.Dither.NONE).save(file, format="PNG")
    return file.getvalue()


def decode_masks(pictures: Iterable[bytes]) -> np.ndarray:
    """PNG bytes of N masks of one resolution as a (N, R, R) bool array.

    Raises `TactileError` where one cannot be read.
    """
    try:
        return np.stack([np.asarray(Image.open(io.BytesIO(png))) != 0 for png in pictures])
    except (OSError, SyntaxError, ValueError, TypeError) as error:
        raise TactileError(
            f"a mask is no picture as the others are ({error}): materialise masks and "
            "rotated_splits again"
        ) from error


def decoded(pictures: pd.Series) -> Iterator[np.ndarray]:
    """All masks in order, some at a time, (n, R, R) bool; a whole table may not fit the memory."""
    return (decode_masks(pictures.iloc[some]) for some in portions(len(pictures)))


def portions(count: int) -> Iterator[slice]:
    """Slices that cover `count` masks, each of as many as are unpacked at a time."""
    return (slice(start, start + AT_A_TIME) for start in range(0, count, AT_A_TIME))
