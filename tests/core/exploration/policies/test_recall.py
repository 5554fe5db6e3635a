"""Recall: known shapes that agree with what was felt, and rays tried on them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_core.exploration.policies import recall
from tactile_core.exploration.policies.bending import bend
from tactile_core.exploration.policies.recall import (
    jaccard_of_each,
    load_known_shapes,
    try_rays,
)
from tactile_core.exploration.policies.references import find_reference
from tactile_core.exploration.policies.scorer import (
    RayScorer,
    best_rays_apart,
    ray_values,
    scorer_images,
)
from tactile_core.exploration.policies.store import RecallPolicy
from tactile_core.exploration.world.rays import candidate_rays
from tactile_core.exploration.world.state import Explorations
from tactile_core.reconstruction.jaccard import jaccard_index
from tactile_core.reconstruction.known_shapes import KnownShapes, pack


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


def test_policies_that_know_the_same_shapes_share_them(shapes):
    masks = shapes["train"].masks
    again = load_known_shapes(pack(masks).tobytes(), 64)
    np.testing.assert_array_equal(again.masks, masks)
    assert load_known_shapes(pack(masks).tobytes(), 64) is again


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
    explorations = explored(shapes["test"].masks[:4], reconstructor, rays=2)
    assert len({felt.tobytes() for felt in recall.all_felt(explorations)}) == 4
    policy = RecallPolicy("recall", 0, scorer, known)
    rays = policy.choose(explorations, np.random.default_rng(5), True)
    count, shapes_each = recall.TRIED_ON[2]
    tried = best_rays_apart(scorer, explorations, count)
    felt = explorations.touches.astype(np.int8) - explorations.free
    drawn = known.draw(felt, shapes_each, np.random.default_rng(5))
    recalled = bend(drawn, felt)
    expected = try_rays(explorations, tried, recalled).mean(axis=2)
    for ray, some, scores in zip(rays, tried, expected, strict=True):
        assert scores[(some == ray).all(axis=1)].max() == scores.max()


def test_every_portion_casts_rays_that_were_tried(
    known, shapes, reconstructor, scorer, monkeypatch
):
    explorations = explored(shapes["test"].masks, reconstructor, rays=2)
    monkeypatch.setattr(recall, "PIXELS_AT_A_TIME", 1)
    policy = RecallPolicy("recall", 0, scorer, known)
    rays = policy.choose(explorations, np.random.default_rng(0), True)
    tried = best_rays_apart(scorer, explorations, recall.TRIED_ON[2][0])
    assert all((some == ray).all(axis=1).any() for ray, some in zip(rays, tried, strict=True))


def test_a_policy_that_felt_the_same_casts_the_same_ray(known, shapes, reconstructor, scorer):
    masks = shapes["test"].masks
    explorations = explored(masks[[0, 1, 0, 2]], reconstructor, rays=3)
    policy = RecallPolicy("recall", 0, scorer, known)
    rays = policy.choose(explorations, np.random.default_rng(0), True)
    assert (rays[0] == rays[2]).all()
    untouched = Explorations(masks, reconstructor)
    assert len(np.unique(policy.choose(untouched, np.random.default_rng(0), True), axis=0)) == 1


def test_what_was_felt_by_as_many_rays_is_told_from_what_is_new(shapes, reconstructor):
    explorations = explored(shapes["test"].masks[[0, 1, 0, 1, 0]], reconstructor, rays=2)
    explorations.rays[4] = 5  # the same felt, by more rays
    first, same = recall.distinct(explorations)
    assert first.tolist() == [0, 1, 4]
    assert same.tolist() == [0, 1, 0, 1, 2]


@pytest.mark.parametrize("rays", range(6))
def test_the_less_was_felt_the_more_shapes_are_recalled(
    rays, known, shapes, reconstructor, scorer, monkeypatch
):
    explorations = explored(shapes["test"].masks[:2], reconstructor, rays)
    tried = []
    monkeypatch.setattr(recall, "try_rays", lambda *what: tried.append(what) or try_rays(*what))
    RecallPolicy("recall", 0, scorer, known).choose(explorations, np.random.default_rng(0), True)
    expected = recall.TRIED_ON[min(rays, len(recall.TRIED_ON) - 1)]
    assert {(which.shape[1], shape.shape[1]) for _, which, shape in tried} == {expected}
    shapes_each = [count for _, count in recall.TRIED_ON]
    assert shapes_each == sorted(set(shapes_each), reverse=True)


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 5), st.integers(1, 7), st.integers(0, 2**32 - 1))
def test_every_prediction_is_compared_with_every_mask(predictions, masks, seed):
    rng = np.random.default_rng(seed)
    predicted = (rng.random((predictions, 8, 8)) * rng.random((predictions, 1, 1))).astype("f")
    inside = rng.random((masks, 8, 8)) < rng.random((masks, 1, 1)) - 0.2
    np.testing.assert_array_equal(
        jaccard_of_each(predicted, inside), jaccard_index(predicted[:, None], inside[None])
    )
