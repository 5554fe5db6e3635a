"""Shapes that were recalled, bent to what was felt."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tactile_core.dataset.outlines import outline
from tactile_core.exploration.policies.bending import bend
from tactile_core.exploration.policies.references import find_reference
from tactile_core.exploration.world.state import Explorations
from tactile_core.reconstruction.jaccard import jaccard_index

seeds = st.integers(0, 2**31)


def disc(radius: float, row: float = 32, column: float = 32) -> np.ndarray:
    rows, columns = np.indices((64, 64))
    return np.hypot(rows - row, columns - column) <= radius


def touched(mask: np.ndarray, count: int, seed: int = 0) -> np.ndarray:
    """So many touches of a mask's outline, (1, R, R) int8."""
    points = outline(mask)
    chosen = np.random.default_rng(seed).choice(len(points), min(count, len(points)), replace=False)
    felt = np.zeros((1, *mask.shape), np.int8)
    felt[0, points[chosen, 0], points[chosen, 1]] = 1
    return felt


@given(seeds, st.integers(0, 10))
def test_bent_shapes_hold_every_touch_and_no_pixel_that_was_seen_free(seed, count):
    rng = np.random.default_rng(seed)
    felt = touched(disc(10), count, seed)
    felt[(rng.random(felt.shape) < 0.05) & (felt == 0)] = -1
    shapes = rng.random((1, 3, 64, 64)) < 0.5
    bent = bend(shapes, felt)[0, :, 16:48, 16:48]
    assert bent[:, felt[0, 16:48, 16:48] > 0].all()
    assert not bent[:, felt[0, 16:48, 16:48] < 0].any()


@given(seeds, st.integers(0, 10))
def test_a_shape_that_agrees_stays_as_it_is(seed, count):
    mask = disc(9) | disc(4, 32, 42)
    felt = touched(mask, count, seed)
    felt[0, :12] = -1
    np.testing.assert_array_equal(bend(mask[None, None], felt)[0, 0], mask)


@given(seeds, st.sampled_from([(8, 33, 33), (12, 32, 32), (10, 34, 30), (6, 31, 32)]))
def test_bending_brings_a_shape_nearer_to_the_one_that_was_felt(seed, true):
    mask, other = disc(*true), disc(10)
    bent = bend(other[None, None], touched(mask, 8, seed))[0]
    before = jaccard_index(other[None].astype(np.float32), mask[None])
    assert jaccard_index(bent.astype(np.float32), mask[None]) > before


def test_a_shape_far_from_every_touch_is_left_where_it_is():
    far = disc(3, 22, 22)
    felt = np.zeros((1, 64, 64), np.int8)
    felt[0, 45, 45] = 1
    bent = bend(far[None, None], felt)[0, 0]
    assert bent[45, 45]
    bent[45, 45] = False
    np.testing.assert_array_equal(bent, far)


def test_shapes_of_one_object_are_not_bent_to_the_touches_of_another(shapes, reconstructor):
    masks = shapes["test"].masks[:4]
    explorations = Explorations(masks, reconstructor)
    for _ in range(4):
        explorations.cast(find_reference("even").choose(explorations, np.random.default_rng(0)))
    felt = explorations.touches.astype(np.int8) - explorations.free.astype(np.int8)
    recalled = np.stack([masks, masks[::-1]], axis=1)
    together = bend(recalled, felt)
    alone = [bend(recalled[[n]], felt[[n]])[0] for n in range(len(masks))]
    np.testing.assert_array_equal(together, alone)
    np.testing.assert_array_equal(together[:, 0], masks)
