"""Masks as 1-bit PNG bytes, the form in which tables hold them."""

import io
from collections.abc import Iterable

import numpy as np
from PIL import Image

from tactile_core.errors import TactileError


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
