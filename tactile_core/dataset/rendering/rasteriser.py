"""Silhouettes without OpenGL: which pixels do a mesh's projected triangles cover?

The coverage rule is OpenGL's. Vertices snap to 1/256 of a pixel, a pixel is covered when its
centre lies in a triangle, a centre on an edge belongs to the triangle on one side of that edge
only, both windings count, and a triangle without area covers nothing. All arithmetic after the
snapping is in integers, so the result is exact.
"""

import numpy as np

from tactile_core.compiled import compiled
from tactile_core.dataset.rendering.camera import STEPS


def rasterise(points: np.ndarray, faces: np.ndarray, resolution: int) -> np.ndarray:
    """The (R, R) bool mask that triangles cover.

    points : (V, 2) float (row, column) image coordinates, see `camera`; may lie outside the image
    faces : (F, 3) int indices into `points`
    """
    centred = np.rint((np.asarray(points, dtype=np.float64) - 0.5) * STEPS).astype(np.int64)
    mask = np.zeros((resolution, resolution), dtype=np.bool_)
    _fill(centred, np.ascontiguousarray(faces, dtype=np.int64), mask, STEPS)
    return mask


@compiled
def _fill(points: np.ndarray, faces: np.ndarray, mask: np.ndarray, steps: int) -> None:
    """Set the pixels of `mask` whose centres lie in a triangle.

    points : (V, 2) int64 (row, column) in 1/`steps` pixel, pixel centres at multiples of `steps`
    """
    height, width = mask.shape
    for face in range(len(faces)):
        r0, c0 = points[faces[face, 0]]
        r1, c1 = points[faces[face, 1]]
        r2, c2 = points[faces[face, 2]]
        top = max(-(-min(r0, r1, r2) // steps), 0)
        bottom = min(max(r0, r1, r2) // steps, height - 1)
        left = max(-(-min(c0, c1, c2) // steps), 0)
        right = min(max(c0, c1, c2) // steps, width - 1)
        if top > bottom or left > right:
            continue
        area = (c1 - c0) * (r2 - r0) - (r1 - r0) * (c2 - c0)
        if area == 0:
            continue
        if area < 0:  # now every triangle runs clockwise as seen in the image
            r1, c1, r2, c2 = r2, c2, r1, c1
        # Each edge function is positive inside; it is 0 on the edge, where the bias decides.
        dr0, dc0, dr1, dc1, dr2, dc2 = r1 - r0, c1 - c0, r2 - r1, c2 - c1, r0 - r2, c0 - c2
        row, column = top * steps, left * steps
        edge0 = dc0 * (row - r0) - dr0 * (column - c0) - _bias(dr0, dc0)
        edge1 = dc1 * (row - r1) - dr1 * (column - c1) - _bias(dr1, dc1)
        edge2 = dc2 * (row - r2) - dr2 * (column - c2) - _bias(dr2, dc2)
        for r in range(top, bottom + 1):
            e0, e1, e2 = edge0, edge1, edge2
            for c in range(left, right + 1):
                if (e0 | e1 | e2) >= 0:
                    mask[r, c] = True
                e0 -= dr0 * steps
                e1 -= dr1 * steps
                e2 -= dr2 * steps
            edge0 += dc0 * steps
            edge1 += dc1 * steps
            edge2 += dc2 * steps


@compiled
def _bias(dr: int, dc: int) -> int:
    """0 for the edges that own the pixel centres on them (Mesa: left and bottom ones), else 1."""
    return 0 if dr < 0 or (dr == 0 and dc < 0) else 1
