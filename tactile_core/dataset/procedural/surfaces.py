"""Closed surfaces that generated objects are put together from: lofts and swept tubes.

Model space: +Y is up, +X is where handles point, lengths are free until `assemble` scales them.
Every surface is watertight and wound outwards; bodies may overlap, as in ShapeNet.
"""

from collections.abc import Sequence

import numpy as np
import trimesh
from numpy.typing import ArrayLike

SEGMENTS = 32  # points around a loft: a multiple of 8 keeps the corners of square sections
TUBE_SEGMENTS = 16


def loft(
    profile: ArrayLike,
    *,
    depth: ArrayLike = 1.0,
    exponent: ArrayLike = 2.0,
    shift: ArrayLike = 0.0,
) -> trimesh.Trimesh:
    """A body whose horizontal sections are superellipses.

    profile : (n, 2) radius along X and height of each section, in an order that has the body on
        its left in the (radius, height) plane (upwards outside, downwards inside a cavity)
    depth : scalar or (n,), radius along Z as a share of that along X
    exponent : scalar or (n,), 2 is an ellipse, larger is squarer
    shift : scalar or (n,), moves each section along X
    """
    radius, height = np.asarray(profile, dtype=float).T
    angle = np.arange(SEGMENTS) * (2 * np.pi / SEGMENTS)
    power = 2 / np.broadcast_to(exponent, radius.shape)[:, None]
    x = radius[:, None] * _signed_power(np.cos(angle), power)
    z = (radius * depth)[:, None] * _signed_power(np.sin(angle), power)
    x = x + np.broadcast_to(shift, radius.shape)[:, None]
    y = np.broadcast_to(height[:, None], x.shape)
    return _closed(np.stack([x, y, z], axis=-1))


def tube(path: ArrayLike, thickness: float, width: float, exponent: float = 2.0) -> trimesh.Trimesh:
    """A strap or rod swept along `path` (n, 2), points (x, y) in the plane z = 0.

    thickness, width : half the section's size in the plane and along Z
    """
    points = np.asarray(path, dtype=float)
    tangent = np.gradient(points, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    angle = np.arange(TUBE_SEGMENTS) * (2 * np.pi / TUBE_SEGMENTS)
    inside = thickness * _signed_power(np.cos(angle), 2 / exponent)
    across = width * _signed_power(np.sin(angle), 2 / exponent)
    x = points[:, :1] + tangent[:, 1:] * inside
    y = points[:, 1:] - tangent[:, :1] * inside
    z = np.broadcast_to(across, x.shape)
    return _closed(np.stack([x, y, z], axis=-1))


def turned(mesh: trimesh.Trimesh, degrees: float) -> trimesh.Trimesh:
    """`mesh` turned about the Y axis, from +X towards +Z."""
    cos, sin = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    turn = np.array([[cos, 0, -sin], [0, 1, 0], [sin, 0, cos]])
    return trimesh.Trimesh(mesh.vertices @ turn.T, mesh.faces, process=False)


def assemble(bodies: Sequence[trimesh.Trimesh]) -> trimesh.Trimesh:
    """All bodies as one mesh, centred on its bounding box, with a bounding-box diagonal of 1."""
    starts = np.cumsum([0] + [len(body.vertices) for body in bodies[:-1]])
    vertices = np.concatenate([body.vertices for body in bodies])
    faces = np.concatenate([body.faces + start for body, start in zip(bodies, starts, strict=True)])
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    vertices = (vertices - (low + high) / 2) / np.linalg.norm(high - low)
    return trimesh.Trimesh(vertices, faces, process=False)


def _signed_power(values: np.ndarray, power: ArrayLike) -> np.ndarray:
    """|values| to a power, with the sign of values."""
    return np.sign(values) * np.abs(values) ** power


def _closed(rings: np.ndarray) -> trimesh.Trimesh:
    """Rings of points (n, segments, 3) as a tube of triangles, both ends closed by fans."""
    count, segments = rings.shape[:2]
    here = np.arange(count * segments).reshape(count, segments)
    right = np.roll(here, -1, axis=1)
    a, b, c, d = here[:-1], right[:-1], here[1:], right[1:]
    first, last = count * segments, count * segments + 1
    faces = [
        np.stack([a, c, b], axis=-1),
        np.stack([b, c, d], axis=-1),
        np.stack([here[0], right[0], np.full(segments, first)], axis=-1),
        np.stack([right[-1], here[-1], np.full(segments, last)], axis=-1),
    ]
    vertices = np.concatenate([rings.reshape(-1, 3), rings[[0, -1]].mean(axis=1)])
    return trimesh.Trimesh(
        vertices, np.concatenate([f.reshape(-1, 3) for f in faces]), process=False
    )
