"""The rules: ten rays each at one shape, and nobody learns from the other."""

import numpy as np
import pytest

from tactile_core.exploration.policies.references import find_reference
from tactile_core.exploration.world.rays import RAYS, candidate_rays
from tactile_core.exploration.world.state import Explorations
from tactile_core.play.game import Game, Hand, Opponent, entropy, outcome, told

MANY = candidate_rays(64).reshape(-1, 2)


@pytest.fixture
def mask(shapes) -> np.ndarray:
    return shapes["test"].masks[0]


def cast_all(hand: Hand, seed: int = 0) -> Hand:
    rng = np.random.default_rng(seed)
    for alpha, beta in MANY[rng.integers(len(MANY), size=hand.left)]:
        hand.cast((int(alpha), int(beta)))
    return hand


def test_a_hand_feels_what_an_exploration_in_the_environment_does(mask, either_reconstructor):
    hand = cast_all(Hand(mask, either_reconstructor))
    explorations = Explorations(mask[None], either_reconstructor)
    assert hand.curve(0) == explorations.jaccard.tolist()
    for number, step in enumerate(hand.steps, start=1):
        cast = explorations.cast(np.array([step.ray]))
        assert step.touch == (None if cast.missed[0] else tuple(cast.touches[0]))
        assert step.repeated == cast.repeated[0]
        assert hand.curve(number)[-1] == explorations.jaccard[0]
        np.testing.assert_array_equal(hand.reconstruction(number), explorations.predictions[0])
    assert hand.left == 0


@pytest.mark.parametrize("name", ["even", "oracle", "random"])
def test_an_opponent_casts_the_rays_of_its_policy_whatever_you_do(name, mask, reconstructor):
    policy = find_reference(name)
    alone = Opponent(mask, reconstructor, policy, seed=3)
    while alone.left:
        alone.think()
    game = Game(
        mask, "a bottle", Hand(mask, reconstructor), Opponent(mask, reconstructor, policy, 3)
    )
    assert game.opponent is not None
    for step in cast_all(Hand(mask, reconstructor)).steps:
        assert not game.over
        game.you.cast(step.ray)
        game.opponent.think()
    assert game.over
    assert [step.ray for step in game.opponent.steps] == [step.ray for step in alone.steps]
    assert game.opponent.curve(RAYS) == alone.curve(RAYS)


def test_the_outcome_names_the_shape_and_who_came_nearer(mask, reconstructor):
    you = cast_all(Hand(mask, reconstructor))
    assert (
        outcome(Game(mask, "a jar", you)) == f"It was a jar. You reached {you.curve(RAYS)[-1]:.1f}."
    )
    opponent = Opponent(mask, reconstructor, find_reference("oracle"))
    while opponent.left:
        opponent.think()
    assert opponent.curve(RAYS)[-1] > you.curve(RAYS)[-1]
    assert outcome(Game(mask, "a jar", you, opponent)).endswith(": oracle wins.")


def test_each_ray_is_told_in_a_sentence(mask, reconstructor):
    hand = Hand(mask, reconstructor)
    across, beside = (int(MANY[5][0]), int(MANY[5][1])), (0, 1)
    hand.cast(across)
    assert told(hand).startswith("Ray 1 touched the object: Jaccard index ")
    hand.cast(across)
    assert told(hand).startswith("Ray 2 met a pixel that was touched before: ")
    assert told(hand).endswith("(+0.0).")
    hand.cast(beside)
    assert told(hand).startswith("Ray 3 missed: ")


def test_a_pixel_is_most_uncertain_at_one_half():
    bits = entropy(np.array([0.0, 0.5, 1.0]))
    assert bits[1] == 1
    assert bits[[0, 2]].max() < 1e-4
