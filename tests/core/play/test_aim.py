"""Whatever a pointer or keys do, what is cast is a ray of the environment, and the one shown."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from skimage.draw import line

from tactile_core.exploration.world.circle import circle_pixels, middle
from tactile_core.exploration.world.rays import ray_ends
from tactile_core.play.aim import CAST, DROP, SWING, TURN, Aim, across, nearest, swung, turned

RESOLUTION = 64
PIXELS = len(circle_pixels(RESOLUTION))
somewhere = st.floats(-8, RESOLUTION + 8)
places = st.tuples(somewhere, somewhere)
pixels = st.integers(0, PIXELS - 1)
rays = st.tuples(pixels, pixels).filter(lambda ray: ray[0] != ray[1])


def inside(place) -> bool:
    return np.hypot(*(np.array(place) - middle(RESOLUTION))) < middle(RESOLUTION)


def pixels_of(ray) -> np.ndarray:
    return np.stack(line(*map(int, ray_ends(np.array([ray]), RESOLUTION)[0])), axis=1)


def dragged(start, end) -> Aim:
    aim = Aim(RESOLUTION)
    aim.press(start)
    aim.move(end)
    return aim


@given(start=places, end=places)
def test_a_drag_casts_the_ray_that_it_showed_from_the_pixel_where_it_began(start, end):
    aim = dragged(start, end)
    shown = aim.ray
    cast = aim.release(end)
    assert cast == shown
    if cast is not None:
        assert cast[0] == nearest(start, RESOLUTION) != cast[1]
        assert aim.start is None and aim.ray is None


@given(alpha=pixels, end=places.filter(inside))
def test_the_ray_passes_under_the_pointer(alpha, end):
    start = tuple(circle_pixels(RESOLUTION)[alpha].astype(float))
    assume(np.hypot(end[0] - start[0], end[1] - start[1]) > 4)
    ray = dragged(start, end).release(end)
    assert ray is not None
    # The circle has pixels for some directions only, and a ray is a line of whole pixels.
    assert np.linalg.norm(pixels_of(ray) - end, axis=1).min() < 1.6


@given(start=places, end=places)
def test_two_clicks_cast_the_ray_of_a_drag(start, end):
    aim = Aim(RESOLUTION)
    aim.press(start)
    assert aim.release(start) is None
    aim.move(end)
    shown = aim.ray
    aim.press(end)
    cast = aim.release(end)
    assert cast is not None
    assert cast[0] == nearest(start, RESOLUTION)
    assert shown in (cast, None)
    by_drag = dragged(start, end).release(end)
    assert by_drag in (cast, None)


@given(place=places)
def test_a_pointer_that_only_passes_shows_where_a_ray_would_start_and_casts_none(place):
    aim = Aim(RESOLUTION)
    aim.move(place)
    assert aim.start == nearest(place, RESOLUTION)
    assert aim.ray is None
    assert aim.release(place) is None


@given(ray=rays, steps=st.integers(-500, 500))
def test_a_turned_ray_turns_back(ray, steps):
    there = turned(ray, steps, RESOLUTION)
    assert turned(there, -steps, RESOLUTION) == ray
    assert (there[1] - there[0]) % PIXELS == (ray[1] - ray[0]) % PIXELS


@given(ray=rays, steps=st.integers(-500, 500))
def test_a_ray_never_swings_onto_its_own_start(ray, steps):
    alpha, beta = swung(ray, steps, RESOLUTION)
    assert alpha == ray[0] != beta
    assert 0 <= beta < PIXELS


@given(keys=st.lists(st.tuples(st.sampled_from([*TURN, *SWING]), st.booleans()), min_size=1))
def test_keys_aim_at_rays_and_enter_casts_the_one_shown(keys):
    aim = Aim(RESOLUTION)
    for name, fast in keys:
        assert aim.key(name, fast) is None
        assert aim.ray is not None
        assert aim.ray[0] == aim.start != aim.ray[1]
        assert all(0 <= index < PIXELS for index in aim.ray)
    assert aim.key(CAST[0], False) == aim.ray is not None
    assert aim.key(DROP, False) is None
    assert aim.key(CAST[0], False) is None


def test_the_ray_of_keys_stays_when_the_page_tells_of_a_move_that_was_none():
    aim = Aim(RESOLUTION)
    aim.move((5.0, 5.0))
    aim.key("ArrowUp", True)
    shown = aim.ray
    aim.move((5.0, 5.0))
    assert aim.ray == shown
    aim.move((5.0, 6.0))
    assert aim.ray is None


@pytest.mark.parametrize("resolution", [48, 64, 256])
def test_the_ray_across_passes_the_middle(resolution):
    for alpha in range(len(circle_pixels(resolution))):
        ends = ray_ends(np.array([across(alpha, resolution)]), resolution)[0].astype(float)
        assert np.abs((ends[:2] + ends[2:]) / 2 - middle(resolution)).max() <= 0.5
