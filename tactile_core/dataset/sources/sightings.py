"""Which faces of a mesh can be seen, so that the others do not decide its size and place.

Exports leave strays behind: a face whose corners lie on one line or in one point, or a speck far
away. They draw no pixel, but a bounding box that holds them makes the model small, or nothing.
"""

import numpy as np

from tactile_core.errors import TactileError

FAR = 0.1  # of the bounding box's diagonal: a stray makes the box longer by more than this
# What strays have less area than, together: two thirds of a pixel at the finest resolution, where
# 512 × 512 pixels show a square of twice the diagonal, …
SPECK = 1e-5  # of the diagonal's square
FEW = 1e-3  # … and this part of all area, for where they are far the body is a speck, too
FLAT = 1e-12  # twice the area by the square of the longest edge, of a face that is a line
PORTION = 1 << 18  # faces


def without_unseen(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """The faces without those that can draw no pixel, all of them if these decide nothing.

    vertices : (V, 3) finite float64, of some extent
    faces : (F, 3)

    Left out are faces without area, where the bounding box hangs on one, and strays: faces at one
    side of the box that together have less area than a pixel, but make the box longer by more than
    a tenth of its diagonal. Raises `TactileError` where no face has an area.
    """
    diagonal = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    areas = _areas(vertices, faces, diagonal)
    lows, highs = _spans(vertices, faces)
    seen = areas > 0
    if not seen.any():
        raise TactileError("has no face with an area")
    low, high = lows[seen].min(axis=0), highs[seen].max(axis=0)
    if (lows.min(axis=0) < low).any() or (highs.max(axis=0) > high).any():
        faces, areas, lows, highs = faces[seen], areas[seen], lows[seen], highs[seen]
    few = FEW * areas.sum()
    stays = np.ones(len(faces), dtype=bool)
    while (
        stray := _at_one_side(lows[stays], highs[stays], areas[stays], few, diagonal)
    ) is not None:
        stays[np.flatnonzero(stays)[stray]] = False
    return faces if stays.all() else faces[stays]


def _at_one_side(
    lows: np.ndarray, highs: np.ndarray, areas: np.ndarray, few: float, diagonal: float
) -> np.ndarray | None:
    """Which faces (F,) are strays at one side of the box of all, or None where none are."""
    low, high = lows.min(axis=0), highs.max(axis=0)
    length = float(np.linalg.norm(high - low))
    most = min(few, SPECK * (length / diagonal) ** 2)
    for axis in range(3):
        for ends, limit in (
            (-lows[:, axis], -low[axis] - FAR * length),
            (highs[:, axis], high[axis] - FAR * length),
        ):
            outside = ends > limit
            if areas[outside].sum() < most:
                return outside
    return None


def _areas(vertices: np.ndarray, faces: np.ndarray, diagonal: float) -> np.ndarray:
    """Each face's area (F,) in squares of `diagonal`, 0 where it is flat."""
    areas = np.empty(len(faces))
    for start in range(0, len(faces), PORTION):
        a, b, c = (vertices[corner] / diagonal for corner in faces[start : start + PORTION].T)
        edges = b - a, c - a, c - b
        doubled = np.linalg.norm(np.cross(edges[0], edges[1]), axis=1)
        longest = np.max([(edge**2).sum(axis=1) for edge in edges], axis=0)
        areas[start : start + PORTION] = np.where(doubled > FLAT * longest, doubled / 2, 0)
    return areas


def _spans(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Each face's lowest and highest coordinates, (F, 3) both."""
    lows, highs = np.empty((len(faces), 3)), np.empty((len(faces), 3))
    for start in range(0, len(faces), PORTION):
        corners = vertices[faces[start : start + PORTION]]  # (P, 3 corners, 3)
        lows[start : start + PORTION] = corners.min(axis=1)
        highs[start : start + PORTION] = corners.max(axis=1)
    return lows, highs
