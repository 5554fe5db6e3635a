"""Polygons as triangles: they cover what the polygon covers, and nothing else."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_core.dataset.rendering.camera import project
from tactile_core.dataset.rendering.rasteriser import rasterise
from tactile_core.dataset.sources.parsing import parse_mesh
from tactile_core.dataset.sources.polygons import triangles

U = [(0, 0), (3, 0), (3, 3), (2, 3), (2, 1), (1, 1), (1, 3), (0, 3)]
# A square with a square hole, whose outline leads in and out along one line.
RING = [(0, 0), (4, 0), (4, 4), (0, 4), (0, 0), (1, 1), (1, 3), (3, 3), (3, 1), (1, 1)]


def area(points: np.ndarray) -> float:
    x, y = points.T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2


def cut(points: np.ndarray) -> np.ndarray:
    """The triangles (F, 3, 2) of one polygon in the plane."""
    flat = np.column_stack([points, np.zeros(len(points))])
    return points[triangles(flat, np.array([len(points)]), np.arange(len(points)))]


def assert_covered_once(points: np.ndarray) -> None:
    found = cut(points)
    assert len(found) == len(points) - 2
    areas = np.array([area(one) for one in found])
    whole = area(points)
    # None is wound the other way, so none lies outside where another makes up for it.
    assert (areas * np.sign(whole) >= -1e-9 * abs(whole)).all()
    assert areas.sum() == pytest.approx(whole)


@pytest.mark.parametrize("shape", [U, RING], ids=["U", "ring"])
@pytest.mark.parametrize("first", range(10))
@pytest.mark.parametrize("backwards", [False, True])
def test_a_concave_polygon_is_covered_once_from_whichever_corner_it_begins(shape, first, backwards):
    points = np.roll(np.array(shape, dtype=float), first, axis=0)
    assert_covered_once(points[::-1] if backwards else points)


@settings(deadline=None, max_examples=200)
@given(seed=st.integers(0, 2**31), count=st.integers(4, 40))
def test_a_polygon_about_a_point_is_covered_once_however_jagged(seed, count):
    rng = np.random.default_rng(seed)
    angles = np.sort(rng.uniform(0, 2 * np.pi, count))
    reach = rng.uniform(0.05, 1, count)
    points = np.column_stack([reach * np.cos(angles), reach * np.sin(angles)])
    gaps = np.diff(np.append(angles, angles[0] + 2 * np.pi))
    if gaps.max() < np.pi and gaps.min() > 1e-6:
        assert_covered_once(points)


def test_convex_polygons_stay_fans_from_their_first_corner():
    square = np.array([(0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1), (0.5, 0, -1e-12)])
    counts, corners = np.array([4, 3, 2, 5]), np.array([0, 1, 2, 3, 0, 1, 2, 0, 1, 0, 4, 1, 2, 3])
    expected = [[0, 1, 2], [0, 2, 3], [0, 1, 2], [0, 4, 1], [0, 1, 2], [0, 2, 3]]
    assert triangles(square, counts, corners).tolist() == expected


def test_a_polygon_that_crosses_itself_or_is_not_finite_is_cut_somehow():
    bow = np.array([(0, 0), (2, 2), (2, 0), (0, 2), (1, 3), (-1, 1)], dtype=float)
    assert cut(bow).shape == (4, 3, 2)
    assert cut(np.full((5, 2), np.nan)).shape == (3, 3, 2)
    assert cut(np.zeros((5, 2))).shape == (3, 3, 2)


def profile(kind: str, caps: list[list[int]]) -> bytes:
    """The U, extruded along the camera's direction, with `caps` (from 0), in a format."""
    points = [(w - u, v * 2**0.5, w + u) for w in (0, 1) for v, u in U]
    faces = caps + [[k, (k + 1) % 8, (k + 1) % 8 + 8, k + 8] for k in range(8)]
    rows = [" ".join(map(str, point)) for point in points]
    if kind == ".obj":
        rows = [f"v {row}" for row in rows]
        rows += ["f " + " ".join(str(k + 1) for k in face) for face in faces]
        return "\n".join([*rows, ""]).encode()
    rows += [f"{len(face)} " + " ".join(map(str, face)) for face in faces]
    if kind == ".off":
        return "\n".join([f"OFF {len(points)} {len(faces)} 0", *rows, ""]).encode()
    header = [
        "ply", "format ascii 1.0", f"element vertex {len(points)}", "property float x",
        "property float y", "property float z", f"element face {len(faces)}",
        "property list uchar int vertex_indices", "end_header",
    ]  # fmt: skip
    return "\n".join([*header, *rows, ""]).encode()


@pytest.mark.parametrize("kind", [".obj", ".off", ".ply"])
def test_a_profile_with_a_notch_is_drawn_with_it_in_every_format(kind):
    by_hand = [[0, 1, 4], [0, 4, 5], [1, 2, 3], [1, 3, 4], [0, 5, 6], [0, 6, 7]]
    masks = []
    for cap in ([[*range(8)]], by_hand):
        mesh = parse_mesh(profile(kind, cap + [[k + 8 for k in face] for face in cap]), kind)
        points = project(np.asarray(mesh.vertices), 0, 64)
        masks.append(rasterise(points, np.asarray(mesh.faces), 64))
    np.testing.assert_array_equal(*masks)
    rows, columns = np.nonzero(masks[0])
    box = (np.ptp(rows) + 1) * (np.ptp(columns) + 1)
    assert masks[0].sum() / box == pytest.approx(7 / 9, abs=0.05)
