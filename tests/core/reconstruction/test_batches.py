"""Training batches: masks, and touches drawn from their outlines."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_core.dataset.rendering import pictures
from tactile_core.reconstruction.batches import (
    ORIENTATIONS,
    draw_touch_sets,
    felt_outlines,
    orient,
    outline_touches,
    touch_images,
    training_batches,
)

seeds = st.integers(0, 2**32 - 1)


def epoch(shapes, seed, batch_size, samples=None, draw=None):
    """All (touches, masks) of one epoch, each (N, R, R)."""
    rng = np.random.default_rng(seed)
    draw = draw or felt_outlines(shapes)
    batches = [pair for _, *pair in training_batches(shapes, batch_size, rng, draw, samples)]
    return batches, *(np.concatenate(images) for images in zip(*batches, strict=True))


def standing(mask: np.ndarray) -> bytes:
    """The same bytes for all eight orientations of a mask."""
    turned = [np.rot90(some, turn) for some in (mask, mask.T) for turn in range(4)]
    return min(np.ascontiguousarray(some).tobytes() for some in turned)


@settings(deadline=None, max_examples=20)
@given(seed=seeds, fewest=st.integers(0, 5), more=st.integers(0, 5))
def test_touches_lie_on_the_outline_and_are_as_many_as_asked(shapes, seed, fewest, more):
    train = shapes["train"]
    indices = np.array([3, 0, 3, 17])
    draw = outline_touches(train, fewest, fewest + more)
    points, held = draw(np.random.default_rng(seed), indices)
    assert held.sum(axis=1).min() >= fewest
    assert held.sum(axis=1).max() <= fewest + more
    for index, some, which in zip(indices, points, held, strict=True):
        outline = set(map(tuple, train.outlines[index].tolist()))
        touches = list(map(tuple, some[which].tolist()))
        assert set(touches) <= outline
        assert len(set(touches)) == len(touches)


def test_a_short_outline_is_touched_all_over_and_no_more(shapes):
    train = shapes["train"]
    short = replace(train, outlines=[outline[:3] for outline in train.outlines])
    for touches, outline in zip(
        draw_touch_sets(short, np.random.default_rng(0), 10, 10), short.outlines, strict=True
    ):
        assert sorted(touches.tolist()) == sorted(outline.tolist())


@settings(deadline=None, max_examples=30)
@given(count=st.integers(1, 24), batch_size=st.integers(2, 9), seed=seeds)
def test_an_epoch_meets_every_shape_once_and_no_batch_is_of_one(shapes, count, batch_size, seed):
    some = shapes["train"].select(np.arange(count))
    batches = training_batches(
        some, batch_size, np.random.default_rng(seed), felt_outlines(shapes["train"])
    )
    met = [indices for indices, _, _ in batches]
    assert sorted(np.concatenate(met)) == list(range(count))
    assert all(2 <= len(indices) <= batch_size + 1 for indices in met) or count == 1


def test_one_to_ten_touches_are_equally_likely(shapes):
    indices = np.zeros(10_000, int)
    _, held = outline_touches(shapes["train"])(np.random.default_rng(0), indices)
    counts = np.bincount(held.sum(axis=1), minlength=11)
    assert counts[0] == 0
    assert counts[1:] == pytest.approx(1000, abs=150)  # five standard deviations


def test_every_outline_pixel_is_drawn_equally_often(shapes):
    outline = shapes["train"].outlines[0]
    indices = np.zeros(200 * len(outline), int)
    points, _ = outline_touches(shapes["train"], 1, 1)(np.random.default_rng(0), indices)
    found, counts = np.unique(points[:, 0], axis=0, return_counts=True)
    assert len(found) == len(outline)
    assert counts == pytest.approx(200, abs=75)


def test_touches_drawn_in_portions_are_those_drawn_at_once(shapes, monkeypatch):
    draw = outline_touches(shapes["train"])
    indices = np.arange(len(shapes["train"]))
    at_once = draw(np.random.default_rng(0), indices)
    monkeypatch.setattr(pictures, "AT_A_TIME", 5)
    in_portions = draw(np.random.default_rng(0), indices)
    for one, other in zip(at_once, in_portions, strict=True):
        np.testing.assert_array_equal(one, other)


def test_only_touches_that_are_held_are_drawn():
    points = np.array([[[1, 2], [3, 3]], [[0, 0], [2, 1]]])
    images = touch_images(points, np.array([[True, False], [True, True]]), 4)
    assert np.argwhere(images).tolist() == [[0, 1, 2], [1, 0, 0], [1, 2, 1]]


@settings(deadline=None, max_examples=20)
@given(seed=seeds, batch_size=st.integers(1, 30))
def test_an_epoch_sees_every_shape_once(shapes, seed, batch_size):
    batches, _, masks = epoch(shapes["train"], seed, batch_size)
    assert all(len(images) == batch_size for images, _ in batches[:-1])
    assert sorted(map(standing, masks)) == sorted(map(standing, shapes["train"].masks))


def test_an_epoch_can_end_early(shapes):
    _, touches, masks = epoch(shapes["train"], 0, 4, samples=10)
    assert len(touches) == len(masks) == 10


@settings(deadline=None, max_examples=20)
@given(seed=seeds)
def test_touches_lie_on_their_mask_in_every_orientation(shapes, seed):
    _, touches, masks = epoch(shapes["train"], seed, 5)
    assert touches.any(axis=(1, 2)).all()
    assert not (touches & ~masks).any()


@given(orientation=st.integers(0, ORIENTATIONS - 1))
def test_an_orientation_moves_every_pixel_and_loses_none(orientation):
    images = np.arange(2 * 6 * 6).reshape(2, 6, 6)
    turned = orient(images, orientation)
    np.testing.assert_array_equal(turned[1] - turned[0], 36)
    np.testing.assert_array_equal(np.sort(turned[1].ravel()), images[1].ravel())


def test_the_orientations_differ():
    image = np.arange(9).reshape(1, 3, 3)
    assert len({orient(image, k).tobytes() for k in range(ORIENTATIONS)}) == ORIENTATIONS


def test_the_same_seed_gives_the_same_batches(shapes):
    _, *first = epoch(shapes["train"], 7, 5)
    _, *second = epoch(shapes["train"], 7, 5)
    _, *other = epoch(shapes["train"], 8, 5)
    np.testing.assert_array_equal(first, second)
    assert not np.array_equal(first, other)
