"""Recall: known shapes that agree with what was felt, and rays tried on them."""

import numpy as np
import pytest

from tactile_core.exploration.policies import recall
from tactile_core.exploration.policies.bending import bend
from tactile_core.exploration.policies.recall import load_known_shapes, try_rays
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
    explorations = explored(shapes["test"].masks, reconstructor, rays=2)
    policy = RecallPolicy("recall", 0, scorer, known)
    rays = policy.choose(explorations, np.random.default_rng(5), True)
    tried = best_rays_apart(scorer, explorations, recall.TRIED)
    felt = explorations.touches.astype(np.int8) - explorations.free
    drawn = known.draw(felt, recall.RECALLED, np.random.default_rng(5))
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
    tried = best_rays_apart(scorer, explorations, recall.TRIED)
    assert all((some == ray).all(axis=1).any() for ray, some in zip(rays, tried, strict=True))
