import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_core.dataset.rendering.camera import project
from tactile_core.dataset.rendering.rasteriser import rasterise

RESOLUTION = 64
angles = st.floats(-720, 720)


def cone():
    """An upright cone that leans towards +Z: no symmetry that could hide a mistake."""
    turn = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    base = np.stack([0.2 * np.cos(turn), np.full(40, -0.3), 0.2 * np.sin(turn)], axis=1)
    vertices = np.vstack([base, [[0, 0.3, 0.25]]])
    faces = np.array([(i, (i + 1) % 40, 40) for i in range(40)])
    return vertices, faces


def picture(rotation, resolution=RESOLUTION):
    vertices, faces = cone()
    return rasterise(project(vertices, rotation, resolution), faces, resolution)


def test_the_models_axes_point_where_the_report_has_them():
    """+Y to the right; +Z and −X up; along the viewing axis nothing moves."""
    middle = RESOLUTION / 2
    origin, y, z, x, towards = project(
        np.array([(0, 0, 0), (0, 0.5, 0), (0, 0, 0.5), (0.5, 0, 0), (0.3, 0, 0.3)]), 0, RESOLUTION
    )
    half, slanted = RESOLUTION / 4, RESOLUTION / 4 * np.sqrt(0.5)
    assert origin == pytest.approx((middle, middle))
    assert y == pytest.approx((middle, middle + half))
    assert z == pytest.approx((middle - slanted, middle), abs=1 / 256)
    assert x == pytest.approx((middle + slanted, middle), abs=1 / 256)
    assert towards == pytest.approx((middle, middle))


@settings(deadline=None)
@given(angles)
def test_rotating_keeps_distances_from_the_middle(rotation):
    vertices, _ = cone()
    straight, turned = (
        np.hypot(*(project(vertices, angle, RESOLUTION) - RESOLUTION / 2).T)
        for angle in (0, rotation)
    )
    assert straight == pytest.approx(turned, abs=1 / 128)


@settings(deadline=None)
@given(angles)
def test_coordinates_are_multiples_of_a_256th_of_a_pixel(rotation):
    points = project(cone()[0], rotation, RESOLUTION) * 256
    assert (points == np.rint(points)).all()


@settings(deadline=None)
@given(angles)
def test_a_shape_of_diagonal_one_stays_within_a_quarter_of_the_image(rotation):
    corners = np.array(np.meshgrid(*[(-0.5, 0.5)] * 3)).reshape(3, -1).T / np.sqrt(3)
    distances = np.hypot(*(project(corners, rotation, RESOLUTION) - RESOLUTION / 2).T)
    assert distances.max() <= RESOLUTION / 4 + 1 / 256


@pytest.mark.parametrize("quarters", [1, 2, 3, 4])
def test_a_quarter_turn_of_the_geometry_is_a_quarter_turn_of_the_mask(quarters):
    """Counter-clockwise, as np.rot90 turns."""
    straight, turned = picture(0, 256), picture(90 * quarters, 256)
    assert straight.any()
    assert (np.rot90(straight, quarters) != turned).sum() <= 2  # centres on edges may change side


def test_another_rotation_gives_another_mask():
    assert (picture(0) != picture(30)).sum() > 50
