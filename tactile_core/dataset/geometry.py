"""Geometry as a whole: two files of one object have the same, however they are written and however
the object stands in them."""

import itertools

import numpy as np

from tactile_core.files import content_hash

DIGITS = 3  # of lengths, where an object's bounding box has a diagonal of 1
UPPER = np.triu_indices(3)
# The 48 ways to stand a box: which axis comes where, and which way it points.
POSES = [
    (list(order), np.array(signs))
    for order in itertools.permutations(range(3))
    for signs in itertools.product((1, -1), repeat=3)
]


def geometry_hash(vertices: np.ndarray, faces: np.ndarray) -> str:
    """Hash (16 hex digits) of where the surface of a mesh lies.

    vertices : (V, 3) float, centred and scaled as `parse_mesh` does; faces : (F, 3) int

    It is taken from the surface's area, centre and second moments, which no order of vertices or
    faces, no winding, no way of cutting polygons and no file format changes; nor does a face that
    is there twice, as for both of its sides, another axis that points up, or a mirror. They are
    rounded, so that neither does the rounding of a file; where they lie between two roundings,
    `copies` still knows the objects by their silhouettes.
    """
    faces = np.unique(np.sort(faces, axis=1), axis=0)
    corners = np.asarray(vertices, dtype=np.float64)[faces]  # (F, 3 corners, 3)
    a, b, c = np.moveaxis(corners, 1, 0)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2  # (F,)
    sums = a + b + c  # (F, 3)
    area = areas.sum()
    if area == 0:
        return content_hash("no area")
    centre = areas @ sums / (3 * area)  # (3,)
    parts = np.concatenate([corners, sums[:, None]], axis=1)  # (F, 4, 3)
    second = np.einsum("f,fki,fkj->ij", areas, parts, parts) / (12 * area)  # (3, 3)
    standing = (
        [*(centre[order] * signs), *(second[np.ix_(order, order)] * np.outer(signs, signs))[UPPER]]
        for order, signs in POSES
    )
    return content_hash(rounded([area]), min(map(rounded, standing)))


def rounded(numbers: list[float]) -> list[float]:
    return [round(float(number), DIGITS) + 0.0 for number in numbers]
