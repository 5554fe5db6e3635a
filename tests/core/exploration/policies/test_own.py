"""Functions and models of one's own as policies."""

import numpy as np
import pytest
from sb3_contrib import MaskablePPO, RecurrentPPO
from stable_baselines3 import A2C

from tactile_core.errors import TactileError
from tactile_core.exploration.policies.own import own_policy
from tactile_core.exploration.policies.references import find_reference
from tactile_core.exploration.world.interface import Interface
from tactile_core.exploration.world.rewards import DIFF
from tactile_core.exploration.world.state import Explorations
from tactile_core.exploration.world.vec_env import BatchedTactileEnv

REPORT = Interface()
GRID = Interface("angle and offset", ("free space", "ray number"))


@pytest.fixture
def explorations(shapes, reconstructor) -> Explorations:
    explorations = Explorations(shapes["test"].masks, reconstructor)
    explorations.cast(find_reference("even").choose(explorations, np.random.default_rng(0)))
    return explorations


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def test_a_function_is_shown_what_was_felt_and_names_an_action(explorations):
    seen = []

    def sweep(observation, info):
        seen.append((observation, info))
        return 3 * info["exploration"]["rays"], 5

    rays = own_policy("sweep", sweep, GRID, 64).choose(explorations, rng(), True)
    np.testing.assert_array_equal(rays, GRID.rays(np.tile([3, 5], (len(rays), 1)), 64))
    np.testing.assert_array_equal([one for one, _ in seen], GRID.observe(explorations))
    for index, (_, info) in enumerate(seen):
        assert set(info) == {"exploration"}
        for name in ("touches", "free", "predictions"):
            np.testing.assert_array_equal(
                info["exploration"][name], getattr(explorations, name)[index]
            )


def test_a_function_is_not_shown_the_mask_nor_the_jaccard_index(explorations):
    told = set()
    own_policy(
        "spy", lambda seen, info: (told.update(info["exploration"]), (1, 2))[1], REPORT, 64
    ).choose(explorations, rng(), True)
    assert told == {"touches", "free", "predictions", "held", "rays", "wasted"}


@pytest.mark.parametrize(
    ("action", "said"),
    [
        (7, "returned 7: an action is two whole numbers, alpha and beta"),
        ((1.0, 2.0), r"returned \[1.0, 2.0\]"),
        (None, "returned None"),
        ([[1, 2]], r"returned \[\[1, 2\]\]"),
        ((1, 176), "go up to 175 and 175"),
        ((-1, 3), "go up to 175"),
    ],
)
def test_what_is_no_action_is_told_in_one_sentence(explorations, action, said):
    policy = own_policy("mine", lambda observation, info: action, REPORT, 64)
    with pytest.raises(TactileError, match=said) as refused:
        policy.choose(explorations, rng(), True)
    assert "\n" not in str(refused.value)


@pytest.fixture(scope="module")
def model(shapes, reconstructor) -> A2C:
    env = BatchedTactileEnv(2, shapes["train"].masks, reconstructor, DIFF, interface=GRID)
    return A2C("CnnPolicy", env, seed=0, n_steps=2)


def test_a_model_casts_what_it_predicts(explorations, model):
    policy = own_policy("a2c", model, GRID, 64)
    actions, _ = model.predict(GRID.observe(explorations), deterministic=True)
    np.testing.assert_array_equal(policy.choose(explorations, rng(), True), GRID.rays(actions, 64))


def test_the_rays_that_a_model_draws_hang_on_the_generator_alone(explorations, model):
    policy = own_policy("a2c", model, GRID, 64)
    first, again, other = (
        policy.choose(explorations, np.random.default_rng(seed), False) for seed in (0, 0, 1)
    )
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


@pytest.mark.parametrize(
    ("interface", "said"),
    [
        (REPORT, "trained on observations .*give the actions and channels"),
        (Interface("alpha and beta", GRID.channels), "trained on actions"),
    ],
)
def test_a_model_of_another_interface_is_refused(model, interface, said):
    with pytest.raises(TactileError, match=said):
        own_policy("a2c", model, interface, 64)


@pytest.mark.parametrize(
    ("algorithm", "policy", "said"),
    [(RecurrentPPO, "CnnLstmPolicy", "its memory of the episode"),
     (MaskablePPO, "CnnPolicy", "masks of its actions")],
)  # fmt: skip
def test_a_model_that_goes_by_more_than_it_would_be_shown_is_refused(
    shapes, reconstructor, algorithm, policy, said
):
    env = BatchedTactileEnv(2, shapes["train"].masks, reconstructor, DIFF, interface=GRID)
    with pytest.raises(TactileError, match=f"chooses by {said}"):
        own_policy("theirs", algorithm(policy, env, n_steps=2, batch_size=2), GRID, 64)


def test_what_is_neither_function_nor_model_is_refused():
    with pytest.raises(TactileError, match="mine is a int: give a function"):
        own_policy("mine", 3, REPORT, 64)
