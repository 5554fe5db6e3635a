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
PORTION = 1 << 16  # faces


def without_unseen(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """The faces without those that can draw no pixel, all of them if these decide nothing.

    vertices : (V, 3) finite float64, of some extent
    faces : (F, 3)

    Left out are faces without area, where the bounding box hangs on one, and strays: faces at one
    side of the box that together have less area than a pixel, but make the box longer by more than
    a tenth of its diagonal. Raises `TactileError` where no face has an area.
    """
    diagonal = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    columns = np.ascontiguousarray((vertices / diagonal).T)  # (3, V)
    areas, lows, highs = _measured(columns, faces)
    seen = areas > 0
    if not seen.any():
        raise TactileError("has no face with an area")
    inside = (lows[:, seen].min(axis=1), highs[:, seen].max(axis=1))
    if (columns.min(axis=1) < inside[0]).any() or (columns.max(axis=1) > inside[1]).any():
        faces, areas, lows, highs = faces[seen], areas[seen], lows[:, seen], highs[:, seen]
    few = FEW * areas.sum()
    while (stray := _at_one_side(areas, lows, highs, few)) is not None:
        stay = ~stray
        faces, areas, lows, highs = faces[stay], areas[stay], lows[:, stay], highs[:, stay]
    return faces


def _at_one_side(
    areas: np.ndarray, lows: np.ndarray, highs: np.ndarray, few: float
) -> np.ndarray | None:
    """Which faces (F,) are strays at one side of the box of all, or None where none are."""
    low, high = lows.min(axis=1), highs.max(axis=1)
    length = float(np.linalg.norm(high - low))
    most = min(few, SPECK * length**2)
    for axis in range(3):
        for outside in (
            lows[axis] < low[axis] + FAR * length,
            highs[axis] > high[axis] - FAR * length,
        ):
            if outside.any() and areas[outside].sum() < most:
                return outside
    return None


def _measured(columns: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Each face's area (F,), 0 where it is flat, and its lowest and highest coordinates (3, F)."""
    areas, lows, highs = np.empty(len(faces)), np.empty((3, len(faces))), np.empty((3, len(faces)))
    for start in range(0, len(faces), PORTION):
        part = slice(start, start + PORTION)
        a, b, c = (columns[:, corner] for corner in faces[part].T)  # (3, P) each
        lows[:, part] = np.minimum(np.minimum(a, b), c)
        highs[:, part] = np.maximum(np.maximum(a, b), c)
        u, v, w = b - a, c - a, c - b
        doubled = np.sqrt(
            (u[1] * v[2] - u[2] * v[1]) ** 2
            + (u[2] * v[0] - u[0] * v[2]) ** 2
            + (u[0] * v[1] - u[1] * v[0]) ** 2
        )
        longest = np.maximum(np.maximum(_square(u), _square(v)), _square(w))
        areas[part] = np.where(doubled > FLAT * longest, doubled / 2, 0)
    return areas, lows, highs


def _square(edges: np.ndarray) -> np.ndarray:
    return edges[0] ** 2 + edges[1] ** 2 + edges[2] ** 2
