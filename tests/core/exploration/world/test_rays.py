"""Rays are the pixel lines of scikit-image, and touch what they meet first."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from skimage.draw import line

from tactile_core.dataset.outlines import outline
from tactile_core.exploration.world import rays as world_rays
from tactile_core.exploration.world.circle import circle_pixels, middle
from tactile_core.exploration.world.rays import (
    candidate_rays,
    cast_rays,
    mark_free,
    pixels_along,
    ray_ends,
)

RAYS = 40


@st.composite
def masks_and_rays(draw):
    """A random mask, dense or sparse, in the middle or all over the image, and some rays."""
    resolution = draw(st.sampled_from(range(32, 129, 16)))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    mask = rng.random((resolution, resolution)) < draw(st.sampled_from([0.002, 0.02, 0.3]))
    if draw(st.booleans()):
        outside = np.ones_like(mask)
        outside[resolution // 4 : -resolution // 4, resolution // 4 : -resolution // 4] = False
        mask &= ~outside
    pixels = len(circle_pixels(resolution))
    rays = rng.integers(pixels, size=(RAYS, 2))
    rays[0, 1] = rays[0, 0]  # a ray of one pixel
    return mask, rays


def line_of(ray: np.ndarray, resolution: int) -> list[tuple[int, int]]:
    """The pixels of a ray, as scikit-image draws them."""
    alpha, beta = circle_pixels(resolution)[ray].tolist()
    return list(zip(*(part.tolist() for part in line(*alpha, *beta)), strict=True))


@settings(deadline=None)
@given(masks_and_rays())
def test_a_touch_is_the_first_mask_pixel_on_the_line_from_alpha(drawn):
    mask, rays = drawn
    touches = cast_rays(mask[None], rays, np.zeros(RAYS, int))
    for ray, touch in zip(rays, touches.tolist(), strict=True):
        met = [pixel for pixel in line_of(ray, len(mask)) if mask[pixel]]
        assert tuple(touch) == (met[0] if met else (-1, -1))


@settings(deadline=None)
@given(masks_and_rays())
def test_every_touch_is_a_pixel_of_the_outline(drawn):
    mask, rays = drawn
    mask[[0, -1]] = mask[:, [0, -1]] = False
    mask[tuple(circle_pixels(len(mask)).T)] = False  # rays begin outside the shape
    touches = cast_rays(mask[None], rays, np.zeros(RAYS, int))
    reachable = set(map(tuple, outline(mask).tolist()))
    assert {tuple(touch) for touch in touches.tolist()} - {(-1, -1)} <= reachable


@settings(deadline=None)
@given(masks_and_rays())
def test_free_is_exactly_what_lies_before_the_touch(drawn):
    mask, rays = drawn
    touches = cast_rays(mask[None], rays, np.zeros(RAYS, int))
    free = np.zeros((RAYS, *mask.shape), np.uint8)
    found = mark_free(free, rays, touches)
    assert found.tolist() == free.sum(axis=(1, 2)).tolist()
    for ray, image in zip(rays, free, strict=True):
        crossed = line_of(ray, len(mask))
        hits = [place for place, pixel in enumerate(crossed) if mask[pixel]]
        expected = set(crossed[: hits[0]] if hits else crossed)
        assert set(map(tuple, np.argwhere(image).tolist())) == expected


@pytest.mark.parametrize("apart", [0, 1, 2, -1, -2])
def test_rays_of_few_pixels_are_lines_too(apart):
    pixels = len(circle_pixels(32))
    rays = np.stack([np.arange(pixels), (np.arange(pixels) + apart) % pixels], axis=1)
    free = np.zeros((pixels, 32, 32), np.uint8)
    mark_free(free, rays, np.full((pixels, 2), -1, np.int16))
    for ray, image in zip(rays, free, strict=True):
        assert set(map(tuple, np.argwhere(image).tolist())) == set(line_of(ray, 32))


def test_what_was_free_stays_free_and_is_not_found_again():
    free = np.zeros((1, 32, 32), np.uint8)
    ray, missed = np.array([[0, 40]]), np.array([[-1, -1]], np.int16)
    pixels = len(line_of(ray[0], 32))
    assert mark_free(free, ray, missed).tolist() == [pixels]
    assert mark_free(free, ray, missed).tolist() == [0]
    assert free.sum() == pixels
    crossing = np.array([[20, 60]])
    new = set(line_of(crossing[0], 32)) - set(line_of(ray[0], 32))
    assert mark_free(free, crossing, missed).tolist() == [len(new)]


def test_ray_i_meets_mask_i_unless_told_otherwise():
    masks = np.random.default_rng(0).random((8, 64, 64)) < 0.02
    rays = candidate_rays(64)[:8, 5]
    own = cast_rays(masks, rays)
    for index in range(8):
        only = cast_rays(masks[index][None], rays[index][None])
        np.testing.assert_array_equal(own[index], only[0])
    swapped = cast_rays(masks, rays[::-1], np.arange(8)[::-1])
    np.testing.assert_array_equal(swapped, own[::-1])


def test_a_ray_s_ends_are_alpha_then_beta():
    pixels = circle_pixels(64)
    ends = ray_ends(np.array([[3, 90], [7, 7]]), 64)
    assert ends.tolist() == [[*pixels[3], *pixels[90]], [*pixels[7], *pixels[7]]]


@pytest.mark.parametrize("resolution", [32, 64, 256])
def test_candidate_rays_come_from_every_direction_and_cover_the_middle_half(resolution):
    angles, offsets = 36, 11
    rays = candidate_rays(resolution, angles, offsets)
    ends = ray_ends(rays.reshape(-1, 2), resolution).reshape(angles, offsets, 4).astype(float)
    start = ends[..., :2] - middle(resolution)
    along = ends[..., 2:] - ends[..., :2]
    along /= np.linalg.norm(along, axis=-1, keepdims=True)

    theta = 2 * np.pi * np.arange(angles) / angles
    inward = -np.stack([np.cos(theta), np.sin(theta)], axis=-1)  # (row, column)
    aligned = np.einsum("aoi,ai->ao", along, inward)
    assert (aligned > np.cos(2 / (resolution / 2))).all()  # within two pixels of the circle

    passing = start[..., 0] * along[..., 1] - start[..., 1] * along[..., 0]  # side and distance
    reach = resolution / 4 - 1
    ordered = np.sort(passing, axis=1)
    assert (ordered[:, 0] < -reach + 1.5).all()
    assert (ordered[:, -1] > reach - 1.5).all()
    assert (np.diff(ordered, axis=1) < 2 * reach / (offsets - 1) + 1.5).all()


def test_the_outermost_candidate_rays_pass_a_pixel_inside_the_middle_half():
    """On average over all angles, which takes out that they end at whole pixels."""
    assert candidate_rays(512).shape == (36, 11, 2)
    ends = ray_ends(candidate_rays(512).reshape(-1, 2), 512).astype(float) - np.tile(middle(512), 4)
    start, along = ends[:, :2], ends[:, 2:] - ends[:, :2]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    passing = (start[:, 0] * along[:, 1] - start[:, 1] * along[:, 0]).reshape(36, 11)
    expected = np.linspace(-127, 127, 11)
    side = np.sign(passing[0, -1])
    np.testing.assert_allclose(side * passing.mean(axis=0), expected, atol=0.2)


def test_an_episode_has_the_reports_ten_rays():
    assert world_rays.RAYS == 10
    assert world_rays.RAY_LIMIT == 100  # where ten touches are wanted


def test_the_pixels_along_candidate_rays_are_those_of_their_lines():
    for ray, flat in zip(candidate_rays(48).reshape(-1, 2), pixels_along(48), strict=True):
        expected = [row * 48 + column for row, column in line_of(ray, 48)]
        assert flat[flat >= 0].tolist() == expected
        assert (flat[len(expected) :] == -1).all()
