"""The ideal observer: what can be reached without knowing the shape."""

import numpy as np
import pytest

from tactile_core.exploration.policies import observer
from tactile_core.exploration.policies.observer import IdealObserver
from tactile_core.exploration.policies.references import find_reference
from tactile_core.exploration.policies.scorer import RayScorer
from tactile_core.exploration.world.rays import RAYS, candidate_rays
from tactile_core.exploration.world.state import Explorations
from tactile_core.reconstruction.known_shapes import KnownShapes


@pytest.fixture
def quick(monkeypatch):
    """Few draws: what is tested holds for any number."""
    monkeypatch.setattr(observer, "ROUNDS", ((2, 3), (2, 1)))
    monkeypatch.setattr(observer, "SECOND", 2)
    monkeypatch.setattr(observer, "BEYOND", 2)


def test_with_the_shape_as_its_only_belief_it_casts_what_the_oracle_casts(
    quick, shapes, reconstructor
):
    mask = shapes["test"].masks[:1]
    belief = KnownShapes(mask)
    belief.draw = lambda felt, count, rng: np.repeat(mask[None], count, axis=1)
    explorations = Explorations(mask, reconstructor)
    rng = np.random.default_rng(0)
    for _ in range(3):
        chosen = IdealObserver(belief).choose(explorations, rng, True)
        oracles = find_reference("oracle").choose(explorations, rng, True)
        after = [explorations.select(np.zeros(1, int)).cast(rays) for rays in (chosen, oracles)]
        assert after[0].jaccard[0] == pytest.approx(after[1].jaccard[0], abs=0.01)
        explorations.cast(chosen)


def test_it_never_looks_at_the_mask(quick, shapes, reconstructor):
    belief = KnownShapes(shapes["train"].masks)
    for policy in (IdealObserver(belief), IdealObserver(belief, RayScorer().eval())):
        seen = Explorations(shapes["test"].masks[:2], reconstructor)
        blind = seen.select(np.arange(2))
        blind.masks[:] = False
        rays = [policy.choose(some, np.random.default_rng(0), True) for some in (seen, blind)]
        np.testing.assert_array_equal(*rays)


def test_looking_ahead_it_casts_the_ray_that_is_best_with_the_next_one(
    quick, shapes, reconstructor, monkeypatch
):
    policy = IdealObserver(KnownShapes(shapes["train"].masks), RayScorer().eval())
    explorations = Explorations(shapes["test"].masks[:1], reconstructor)
    monkeypatch.setattr(policy, "two_ahead", lambda one, first, scorer, rng: np.array([0, 2, 1]))
    left = policy.best_rays(explorations, observer.ROUNDS[:-1], np.random.default_rng(1))
    chosen = policy.choose(explorations, np.random.default_rng(1), True)[0]
    np.testing.assert_array_equal(chosen, left[1])


def test_rays_race_and_those_left_have_been_tried_on_every_shape(
    quick, shapes, reconstructor, monkeypatch
):
    policy = IdealObserver(KnownShapes(shapes["train"].masks))
    explorations = Explorations(shapes["test"].masks[:1], reconstructor)
    rays = candidate_rays(64).reshape(-1, 2)
    rounds = [np.arange(396.0), np.array([0.0, 5.0, 0.0, 0.0])]
    scores = iter(rounds)
    tried = []

    def expected(one, candidates, shapes, rng):
        tried.append((len(candidates[0]), shapes))
        return next(scores)[None]

    monkeypatch.setattr(policy, "expected", expected)
    chosen = policy.best_rays(explorations, ((2, 4), (4, 2)), np.random.default_rng(1))
    assert tried == [(396, 2), (4, 4)]
    # After two shapes 395, 394, 393, 392; over all six (395·2, 394·2 + 5·4, …) / 6.
    np.testing.assert_array_equal(chosen, rays[[394, 395]])


def test_the_last_ray_is_chosen_for_itself(quick, shapes, reconstructor):
    belief = KnownShapes(shapes["train"].masks)
    explorations = Explorations(shapes["test"].masks[:1], reconstructor)
    explorations.rays[:] = RAYS - 1
    chosen = [
        policy.choose(explorations, np.random.default_rng(3), True)
        for policy in (IdealObserver(belief), IdealObserver(belief, RayScorer().eval()))
    ]
    np.testing.assert_array_equal(*chosen)
