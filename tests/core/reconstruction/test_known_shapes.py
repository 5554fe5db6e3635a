"""Known shapes: how probable each is after what was felt, their mean, and draws of them."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch.nn import functional

from tactile_core.exploration.practice.ray_touches import free_images, plain_sequences
from tactile_core.reconstruction import known_shapes
from tactile_core.reconstruction.batches import ORIENTATIONS, felt_outlines, orient, touch_images
from tactile_core.reconstruction.known_shapes import (
    KnownShapes,
    coarse,
    pack,
    turned,
    turned_back,
    unpack,
)

seeds = st.integers(0, 2**31)


@pytest.fixture(scope="module")
def known(shapes) -> KnownShapes:
    return KnownShapes(shapes["train"].masks, shapes["train"].model_ids)


def felt_by_rays(shapes) -> np.ndarray:
    """What ten rays, a sweep, felt of each shape, (N, R, R) int8."""
    rays, touches = (some[:, 8] for some in plain_sequences(shapes, np.random.default_rng(0)))
    hit = touches[..., 0] >= 0
    images = touch_images(touches, hit, shapes.resolution)
    return images - free_images(rays, touches, np.ones_like(hit), shapes.resolution)


def felt_at(*places: tuple[int, int, int], resolution: int = 64) -> torch.Tensor:
    """One image (1, R, R) with these values at (row, column)."""
    felt = torch.zeros(1, resolution, resolution)
    for row, column, value in places:
        felt[0, row, column] = value
    return felt


def test_packed_shapes_come_back_as_they_were(shapes):
    masks = shapes["train"].masks
    np.testing.assert_array_equal(unpack(pack(masks), 64), masks)


def test_of_too_many_shapes_some_are_picked_evenly(monkeypatch):
    monkeypatch.setattr(known_shapes, "MOST", 3)
    masks = np.random.default_rng(0).random((8, 48, 48)) < 0.5
    np.testing.assert_array_equal(unpack(pack(masks), 48), masks[::3])


def test_what_is_turned_and_turned_back_is_as_it_was():
    images = torch.rand(3, 6, 6)
    back = turned_back(images).reshape(3, ORIENTATIONS, -1)
    np.testing.assert_array_equal(turned(back, 6), images.flatten(1)[:, None].expand(back.shape))


def test_each_orientation_is_that_of_the_training_batches():
    images = torch.rand(3, 6, 6)
    every = turned(images.flatten(1)[:, None].expand(3, ORIENTATIONS, 36), 6)
    for turn in range(ORIENTATIONS):
        expected = orient(images.numpy(), turn).reshape(3, -1)
        np.testing.assert_array_equal(every[:, turn], expected)


def test_before_anything_is_felt_every_shape_is_as_probable(known):
    weights = known.weights(felt_at()).numpy()
    np.testing.assert_allclose(weights, 1 / (ORIENTATIONS * len(known.masks)), rtol=1e-5)


@pytest.mark.parametrize("turn", range(ORIENTATIONS))
def test_a_shape_that_is_known_is_recalled_in_whatever_orientation_it_is_felt(known, shapes, turn):
    felt = orient(felt_by_rays(shapes["train"]), turn)
    masks = orient(shapes["train"].masks, turn)
    recalled = known.draw(felt, 5, np.random.default_rng(0))
    overlap = (recalled & masks[:, None]).sum((2, 3)) / (recalled | masks[:, None]).sum((2, 3))
    assert np.median(overlap) > 0.9


@pytest.mark.parametrize("place", [(30, 39, 1), (30, 42, -1)], ids=["touch", "free"])
def test_what_was_felt_speaks_against_shapes_that_contradict_it(place):
    """A square that reaches to the middle, beside one whose edge lies where it was touched."""
    right, wrong = np.zeros((2, 64, 64), bool)
    right[24:40, 24:40] = True
    wrong[24:40, 24:44] = True
    known = KnownShapes(np.stack([right, wrong]))
    weights = known.weights(felt_at(place)).numpy()[0]
    assert weights[0] > 2 * weights[1]


@settings(deadline=None, max_examples=15)
@given(seed=seeds)
def test_weights_are_those_of_the_touches_distances_to_each_outline(known, shapes, seed):
    """Said once more, one shape and one touch at a time."""
    felt = felt_outlines(shapes["test"])(np.random.default_rng(seed), np.arange(2))
    weights = known.weights(torch.from_numpy(felt)).numpy()
    evidence = np.zeros_like(weights)
    every = np.concatenate([orient(known.masks, turn) for turn in range(ORIENTATIONS)])
    for index, mask in enumerate(every):
        beside = functional.pad(torch.from_numpy(mask), [1] * 4)
        enclosed = beside[:-2, 1:-1] & beside[2:, 1:-1] & beside[1:-1, :-2] & beside[1:-1, 2:]
        outline = np.argwhere(mask & ~enclosed.numpy())
        for image in range(2):
            for touch in np.argwhere(felt[image] == 1):
                off = np.sqrt(((outline - touch) ** 2).sum(axis=1)).min()
                evidence[image, index] -= (min(off, 3.0) / 0.7) ** 2 / 2
    expected = np.exp(evidence - evidence.max(axis=1, keepdims=True))
    np.testing.assert_allclose(weights, expected / expected.sum(axis=1, keepdims=True), atol=1e-4)


def test_the_mean_is_the_weighted_mean_of_the_shapes(known, shapes):
    felt = torch.from_numpy(felt_by_rays(shapes["test"]))
    weights = known.weights(felt).numpy()
    every = np.concatenate([orient(known.masks, turn) for turn in range(ORIENTATIONS)])
    expected = np.tensordot(weights, every.astype(np.float32), axes=1)
    np.testing.assert_allclose(known.mean(felt).numpy(), expected, atol=1e-5)


def test_a_models_own_shapes_are_not_recalled_for_it(known, shapes):
    train = shapes["train"]
    felt = torch.from_numpy(felt_by_rays(train))
    weights = known.weights(felt, train.model_ids).numpy()
    own = np.tile(train.model_ids[:, None] == train.model_ids, ORIENTATIONS)
    assert weights[own].max() == 0
    np.testing.assert_allclose(weights.sum(axis=1), 1, rtol=1e-5)
    others = known.weights(felt).numpy() * ~own
    others /= others.sum(axis=1, keepdims=True)
    some = np.isfinite(others).all(axis=1)
    np.testing.assert_allclose(weights[some], others[some], atol=1e-3)


@settings(deadline=None, max_examples=10)
@given(seed=seeds)
def test_shapes_are_drawn_as_often_as_they_are_probable(known, shapes, seed):
    felt, count = felt_by_rays(shapes["test"])[:1], 4000
    drawn = known.draw(felt, count, np.random.default_rng(seed))[0]
    weights = known.weights(torch.from_numpy(felt)).numpy()[0]
    every = np.concatenate([orient(known.masks, turn) for turn in range(ORIENTATIONS)])
    for index in weights.argsort()[-3:]:
        same = (every == every[index]).all(axis=(1, 2))
        found = (drawn == every[index]).all(axis=(1, 2)).sum()
        # One draw for each of `count` equal parts: at most two off for every stretch of weights.
        assert abs(found - count * weights[same].sum()) <= 2 * same.sum()


def test_above_64_pixels_shapes_are_compared_in_blocks():
    images = torch.zeros(1, 256, 256)
    images[0, 64, 67] = images[0, 191, 188] = 1
    small = coarse(images)
    assert small.shape == (1, 32, 32)
    assert np.argwhere(small[0].numpy()).tolist() == [[0, 0], [31, 31]]
    for resolution in (48, 64, 112, 128, 208, 1008, 1024):
        assert 24 <= coarse(torch.zeros(1, resolution, resolution)).shape[1] < 64


@pytest.mark.parametrize("resolution", [48, 112, 144, 256])
def test_shapes_are_known_at_every_resolution(resolution):
    masks = np.zeros((2, resolution, resolution), bool)
    quarter = resolution // 4
    masks[0, quarter + 4 : 2 * quarter, quarter + 4 : 2 * quarter] = True
    masks[1, quarter + 8 : 3 * quarter - 8, quarter + 4 : quarter + 12] = True
    for mask in masks:
        corners = np.argwhere(mask)[[0, -1]]
        felt = felt_at(*((*corner, 1) for corner in corners), resolution=resolution)
        inside = KnownShapes(masks).mean(felt).numpy()[0] > 0.5
        assert inside.shape == mask.shape
        assert (inside & mask).sum() / (inside | mask).sum() > 0.8
