"""Polygons and strips as triangles."""

import numpy as np

from tactile_core.dataset.sources.ears import INWARDS, cut_concave
from tactile_core.dataset.sources.text import starts
from tactile_core.errors import TactileError

MOST_TRIANGLES = 1 << 24  # of one mesh: 400 MB, and as much again for a copy


def triangles(vertices: np.ndarray, counts: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Polygons of `counts` corners each as triangles (F, 3); fewer than 3 corners give none.

    vertices : (V, 3); corners : (sum of counts,) int64, numbers of vertices

    A convex polygon becomes a fan from its first corner, and any other is cut ear by ear. Whether
    the vertices exist is for the caller to look at.
    """
    if (counts == 3).all():
        check_number(len(counts))
        return corners.reshape(-1, 3)
    fan = np.maximum(counts - 2, 0)
    check_number(int(fan.sum()))
    first = np.repeat(starts(counts), fan)
    step = np.arange(fan.sum()) - np.repeat(starts(fan), fan)
    cut = corners[np.stack([first, first + step + 1, first + step + 2], axis=1)]
    if (counts > 3).any() and corners.min() >= 0 and corners.max() < len(vertices):
        places = starts(counts), starts(fan)
        cut_concave(vertices.astype(np.float64), counts, corners, *places, cut, INWARDS)
    return cut


def strips(corners: np.ndarray) -> np.ndarray:
    """Strips, each ended by an index of -1, as triangles (F, 3), all wound alike."""
    check_number(len(corners))
    ends = corners < 0
    places = np.arange(len(corners))
    strip_starts = np.maximum.accumulate(np.where(ends, places + 1, 0))
    whole = ~(ends[:-2] | ends[1:-1] | ends[2:])
    cut = np.stack([corners[:-2], corners[1:-1], corners[2:]], axis=1)[whole]
    odd = ((places - strip_starts)[:-2][whole] % 2).astype(bool)
    cut[odd] = cut[odd][:, [1, 0, 2]]
    return cut


def check_number(number: int) -> None:
    """Raises `TactileError` where there are more triangles than fit in memory with ease."""
    if number > MOST_TRIANGLES:
        raise TactileError(f"has {number} triangles, more than {MOST_TRIANGLES}")
