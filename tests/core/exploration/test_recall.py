"""Recall: known shapes that agree with what was felt, and rays tried on them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_core.exploration import policies, recall
from tactile_core.exploration.policies import RecallPolicy
from tactile_core.exploration.rays import candidate_rays
from tactile_core.exploration.recall import KnownShapes, coarse, known_shapes, pack, try_rays
from tactile_core.exploration.references import find_reference
from tactile_core.exploration.scorer import RayScorer, best_rays_apart, ray_values, scorer_images
from tactile_core.exploration.state import Explorations
from tactile_core.reconstruction.batches import ORIENTATIONS, orient

seeds = st.integers(0, 2**31)


@pytest.fixture(scope="module")
def known(shapes) -> KnownShapes:
    return KnownShapes(shapes["train"].masks)


@pytest.fixture(scope="module")
def scorer() -> RayScorer:
    return RayScorer().eval()


def explored(masks, reconstructor, rays: int) -> Explorations:
    """Explorations after so many rays of the sweep."""
    explorations = Explorations(masks, reconstructor)
    for _ in range(rays):
        explorations.cast(find_reference("even").choose(explorations, np.random.default_rng(0)))
    return explorations


def test_packed_shapes_come_back_as_they_were(shapes):
    masks = shapes["train"].masks
    again = known_shapes(pack(masks).tobytes(), 64)
    np.testing.assert_array_equal(again.masks, masks)
    assert known_shapes(pack(masks).tobytes(), 64) is again


def test_of_too_many_shapes_some_are_picked_evenly(monkeypatch):
    monkeypatch.setattr(recall, "MOST", 3)
    masks = np.random.default_rng(0).random((8, 48, 48)) < 0.5
    np.testing.assert_array_equal(known_shapes(pack(masks).tobytes(), 48).masks, masks[::3])


def test_before_any_ray_every_shape_is_as_probable(known, shapes, reconstructor):
    weights = known.weights(Explorations(shapes["test"].masks, reconstructor)).numpy()
    np.testing.assert_allclose(weights, 1 / (ORIENTATIONS * len(known.masks)))


@pytest.mark.parametrize("turn", range(ORIENTATIONS))
def test_a_shape_that_is_known_is_recalled_in_whatever_orientation_it_is_felt(
    known, shapes, reconstructor, turn
):
    felt = orient(shapes["train"].masks, turn)
    explorations = explored(felt, reconstructor, rays=10)
    recalled = known.draw(explorations, 5, np.random.default_rng(0))
    overlap = (recalled & felt[:, None]).sum((2, 3)) / (recalled | felt[:, None]).sum((2, 3))
    assert np.median(overlap) > 0.9


def test_what_was_felt_speaks_against_shapes_that_contradict_it(shapes, reconstructor):
    """A square that reaches to the middle, beside one whose edge lies where it was touched."""
    right, wrong = np.zeros((2, 64, 64), bool)
    right[24:40, 24:40] = True
    wrong[24:40, 24:44] = True
    known = KnownShapes(np.stack([right, wrong]))
    touched = Explorations(right[None], reconstructor)
    touched.touches[0, 30, 39] = 1
    passed = Explorations(right[None], reconstructor)
    passed.free[0, 30, 42] = 1
    for explorations in (touched, passed):
        weights = known.weights(explorations).numpy()[0]
        assert weights[0] > 2 * weights[1]


@settings(deadline=None, max_examples=10)
@given(seed=seeds)
def test_shapes_are_drawn_as_often_as_they_are_probable(known, shapes, reconstructor, seed):
    explorations = explored(shapes["test"].masks[:1], reconstructor, rays=2)
    count = 4000
    drawn = known.draw(explorations, count, np.random.default_rng(seed))[0]
    weights = known.weights(explorations).numpy()[0]
    for index in weights.argsort()[-3:]:
        turn, which = divmod(index, len(known.masks))
        shape = orient(known.masks[which : which + 1], turn)[0]
        same = [
            weights[other]
            for other in range(len(weights))
            if np.array_equal(
                orient(known.masks[other % len(known.masks)][None], other // len(known.masks))[0],
                shape,
            )
        ]
        found = (drawn == shape).all(axis=(1, 2)).sum()
        # One draw for each of `count` equal parts: at most two off for every stretch of weights.
        assert abs(found - count * sum(same)) <= 2 * len(same)


def test_rays_are_tried_as_if_they_were_cast(shapes, either_reconstructor):
    masks = shapes["test"].masks
    explorations = explored(masks[:3], either_reconstructor, rays=3)
    rays = np.random.default_rng(0).integers(100, size=(3, 4, 2))
    guessed = np.stack([masks[:3], masks[3:6]], axis=1)
    scores = try_rays(explorations, rays, guessed)
    assert scores.shape == (3, 4, 2)
    for ray in range(4):
        for shape in range(2):
            explorer = explorations.select(np.arange(3))
            explorer.masks[:] = guessed[:, shape]
            cast = explorer.cast(rays[:, ray])
            gained = ~cast.missed & ~cast.repeated
            np.testing.assert_allclose(scores[gained, ray, shape], cast.jaccard[gained], atol=1e-4)


def test_the_rays_to_try_are_the_best_ones_that_are_not_neighbours(shapes, reconstructor, scorer):
    explorations = explored(shapes["test"].masks[:3], reconstructor, rays=2)
    values = ray_values(scorer, scorer_images(explorations), explorations.rays)
    grid = candidate_rays(64).reshape(-1, 2)
    apart = {tuple(grid[11 * a + b]) for a in range(36) for b in range(a % 2, 11, 2)}
    for rays, some in zip(best_rays_apart(scorer, explorations, 5), values, strict=True):
        best_first = [tuple(grid[index]) for index in np.argsort(-some, kind="stable")]
        expected = [ray for ray in best_first if ray in apart][:5]
        assert [tuple(ray) for ray in rays] == expected


def test_recall_casts_the_best_of_the_rays_it_tried(known, shapes, reconstructor, scorer):
    explorations = explored(shapes["test"].masks, reconstructor, rays=2)
    rays = RecallPolicy(0, scorer, known).choose(explorations, np.random.default_rng(5), True)
    tried = best_rays_apart(scorer, explorations, policies.TRIED)
    recalled = known.draw(explorations, policies.RECALLED, np.random.default_rng(5))
    expected = try_rays(explorations, tried, recalled).mean(axis=2)
    for ray, some, scores in zip(rays, tried, expected, strict=True):
        assert scores[(some == ray).all(axis=1)].max() == scores.max()


def test_recall_never_looks_at_the_true_shape(known, shapes, reconstructor, scorer):
    policy = RecallPolicy(0, scorer, known)
    explorations = explored(shapes["test"].masks, reconstructor, rays=2)
    seen = policy.choose(explorations, np.random.default_rng(0), True)
    explorations.masks = np.zeros_like(explorations.masks)
    blind = policy.choose(explorations, np.random.default_rng(0), True)
    np.testing.assert_array_equal(seen, blind)


def test_every_portion_casts_rays_that_were_tried(
    known, shapes, reconstructor, scorer, monkeypatch
):
    explorations = explored(shapes["test"].masks, reconstructor, rays=2)
    monkeypatch.setattr(policies, "PIXELS_AT_A_TIME", 1)
    rays = RecallPolicy(0, scorer, known).choose(explorations, np.random.default_rng(0), True)
    tried = best_rays_apart(scorer, explorations, policies.TRIED)
    assert all((some == ray).all(axis=1).any() for ray, some in zip(rays, tried, strict=True))


def test_above_64_pixels_shapes_are_compared_in_blocks():
    images = np.zeros((1, 256, 256), np.uint8)
    images[0, 64, 67] = images[0, 191, 188] = 1
    small = coarse(images)
    assert small.shape == (1, 32, 32)
    assert np.argwhere(small[0]).tolist() == [[0, 0], [31, 31]]
    assert not coarse(images, np.min).any()
    for resolution in (48, 64, 112, 128, 208, 1008, 1024):
        side = coarse(np.zeros((1, resolution, resolution), bool)).shape[1]
        assert 24 <= side < 64
