"""Polygons with corners that turn inwards, cut into triangles ear by ear.

A fan from one corner would fill their notches. After G. Meisters, Polygons have ears, 1975.
"""

import numpy as np

from tactile_core.compiled import compiled

# The sine of the angle by which a corner has to turn inwards: rounded coordinates make a straight
# one turn by less, and then both ways of cutting draw the same.
INWARDS = 1e-6


@compiled
def cut_concave(
    vertices: np.ndarray,
    counts: np.ndarray,
    corners: np.ndarray,
    begins: np.ndarray,
    places: np.ndarray,
    cut: np.ndarray,
    inwards: float,
) -> None:
    """Give polygons that are not convex other triangles than their fans, in `cut` (F, 3).

    vertices : (V, 3) float64
    counts : of each polygon's corners, which are numbers of vertices in `corners`
    begins, places : where each one's corners and triangles begin
    inwards : `INWARDS`
    """
    for polygon in range(len(counts)):
        if counts[polygon] > 3:
            own = corners[begins[polygon] : begins[polygon] + counts[polygon]]
            flat = _flat(vertices, own)
            if _is_concave(flat, inwards):
                _cut_ears(flat, own, cut[places[polygon] : places[polygon] + len(own) - 2])


@compiled
def _flat(vertices: np.ndarray, own: np.ndarray) -> np.ndarray:
    """A polygon's corners (n, 2), seen along the axis from which it shows most of its area, and
    from the side where they run anticlockwise."""
    count = len(own)
    points = np.empty((count, 3))
    for k in range(count):
        points[k] = vertices[own[k]] - vertices[own[0]]
    normal = np.zeros(3)  # by Newell
    for k in range(count):
        a, b = points[k], points[(k + 1) % count]
        for axis in range(3):
            i, j = (axis + 1) % 3, (axis + 2) % 3
            normal[axis] += (a[i] - b[i]) * (a[j] + b[j])
    along = np.argmax(np.abs(normal))
    flat = np.empty((count, 2))
    flat[:, 0] = points[:, (along + 1) % 3]
    flat[:, 1] = points[:, (along + 2) % 3] * np.sign(normal[along])
    return flat


@compiled
def _is_concave(flat: np.ndarray, inwards: float) -> bool:
    """Whether any corner turns inwards; not so where coordinates are not finite."""
    count = len(flat)
    for k in range(count):
        if _turn(flat, (k + count - 1) % count, k, (k + 1) % count) < -inwards:
            return True
    return False


@compiled
def _cut_ears(flat: np.ndarray, own: np.ndarray, cut: np.ndarray) -> None:
    """The triangles (n − 2, 3) of a polygon of n corners."""
    left = np.arange(len(own))  # corners of what is left
    k = tried = 0
    for at in range(len(own) - 3):
        count = len(left)
        while tried < count:
            before, here, after = left[(k + count - 1) % count], left[k], left[(k + 1) % count]
            if _is_ear(flat, left, before, here, after):
                break
            k, tried = (k + 1) % count, tried + 1
        # Where there is no ear, as in one that crosses itself, any corner is taken.
        before, here, after = left[(k + count - 1) % count], left[k], left[(k + 1) % count]
        cut[at, 0], cut[at, 1], cut[at, 2] = own[before], own[here], own[after]
        left[k : count - 1] = left[k + 1 :].copy()
        left = left[: count - 1]
        k, tried = k % len(left), 0
    for k in range(3):
        cut[-1, k] = own[left[k]]


@compiled
def _turn(flat: np.ndarray, before: int, here: int, after: int) -> float:
    """The sine of the angle by which the way turns to the left at a corner; 0 where one step of it
    has no length."""
    ux, uy = flat[here, 0] - flat[before, 0], flat[here, 1] - flat[before, 1]
    vx, vy = flat[after, 0] - flat[here, 0], flat[after, 1] - flat[here, 1]
    lengths = np.sqrt((ux * ux + uy * uy) * (vx * vx + vy * vy))
    return (ux * vy - uy * vx) / lengths if lengths > 0 else 0.0


@compiled
def _is_ear(flat: np.ndarray, left: np.ndarray, before: int, here: int, after: int) -> bool:
    """Whether the triangle of three corners in a row turns to the left and holds no other corner.

    One that lies where they do, as where a hole is joined to the outline, is none of its own.
    """
    if _turn(flat, before, here, after) < 0:
        return False
    for other in left:
        if (
            _side(flat, before, here, other) >= 0
            and _side(flat, here, after, other) >= 0
            and _side(flat, after, before, other) >= 0
            and not _same(flat, other, before)
            and not _same(flat, other, here)
            and not _same(flat, other, after)
        ):
            return False
    return True


@compiled
def _side(flat: np.ndarray, a: int, b: int, other: int) -> float:
    """Positive where a point lies to the left of the line from a to b."""
    ux, uy = flat[b, 0] - flat[a, 0], flat[b, 1] - flat[a, 1]
    return ux * (flat[other, 1] - flat[a, 1]) - uy * (flat[other, 0] - flat[a, 0])


@compiled
def _same(flat: np.ndarray, one: int, other: int) -> bool:
    return flat[one, 0] == flat[other, 0] and flat[one, 1] == flat[other, 1]
