"""The circle that rays start and end on (report, section VI.A)."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from skimage.draw import circle_perimeter

from tactile_core.exploration.world.circle import (
    angle_index,
    circle_pixels,
    middle,
    report_circle,
    report_order,
    turn,
)

resolutions = st.sampled_from([32, 48, 64, 128, 256])


def test_the_report_has_720_pixels_at_its_resolution():
    assert len(circle_pixels(256)) == 720
    assert len(circle_pixels(64)) == 176


@given(resolutions)
def test_the_circle_has_radius_half_the_image_less_one_around_the_middle_pixel(resolution):
    pixels = circle_pixels(resolution)
    radii = np.linalg.norm(pixels - middle(resolution), axis=1)
    assert radii == pytest.approx(resolution / 2 - 1, abs=0.75)
    assert pixels.min() == 0
    assert pixels.max() == resolution - 2


@given(resolutions)
def test_its_pixels_are_distinct_and_each_touches_the_next(resolution):
    pixels = circle_pixels(resolution)
    assert len(set(map(tuple, pixels.tolist()))) == len(pixels)
    steps = np.abs(pixels - np.roll(pixels, 1, axis=0)).max(axis=1)
    assert (steps == 1).all()


@given(resolutions)
def test_they_go_round_once_from_below_the_middle_towards_larger_columns(resolution):
    pixels = circle_pixels(resolution)
    rows, columns = (pixels - middle(resolution)).T
    angles = np.arctan2(columns, rows) % (2 * np.pi)
    assert (np.diff(angles) > 0).all()
    assert pixels[0].tolist() == [resolution - 2, middle(resolution)]
    quarter = pixels[len(pixels) // 4]
    assert quarter.tolist() == [middle(resolution), resolution - 2]


@given(resolutions)
def test_the_report_s_order_is_that_of_scikit_image(resolution):
    centre = middle(resolution)
    rows, columns = circle_perimeter(centre, centre, resolution // 2 - 1)
    drawn = list(dict.fromkeys(zip(rows.tolist(), columns.tolist(), strict=True)))
    assert [tuple(pixel) for pixel in report_circle(resolution).tolist()] == drawn
    ordered = circle_pixels(resolution)[report_order(resolution)]
    np.testing.assert_array_equal(ordered, report_circle(resolution))


@given(resolutions, st.lists(st.floats(-20, 20), min_size=1, max_size=9))
def test_an_angle_s_pixel_is_the_nearest_in_direction(resolution, angles):
    rows, columns = (circle_pixels(resolution) - middle(resolution)).T
    directions = np.arctan2(columns, rows)
    for angle, index in zip(angles, angle_index(np.array(angles), resolution), strict=True):
        away = np.abs(turn(directions - angle))
        assert away[index] == pytest.approx(away.min(), abs=1e-9)


@given(st.floats(-50, 50))
def test_a_turned_angle_is_the_same_direction_within_half_a_circle(angle):
    turned = turn(np.array(angle))
    assert -np.pi <= turned < np.pi
    assert np.exp(1j * turned) == pytest.approx(np.exp(1j * angle))


def test_the_shared_pixels_cannot_be_changed():
    with pytest.raises(ValueError, match="read-only"):
        circle_pixels(64)[0] = 0
