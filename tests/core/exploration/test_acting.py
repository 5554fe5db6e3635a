"""Every policy of the tables acts in the environment as it casts rays in the evaluations."""

import dataclasses

import gymnasium as gym
import numpy as np
import pytest

import tactile_core
from tactile_core import ENV_ID
from tactile_core.errors import TactileError
from tactile_core.exploration.acting import find_policy
from tactile_core.exploration.environments import make_sb3_env
from tactile_core.exploration.policies.base import policy_rng
from tactile_core.exploration.policies.references import REFERENCES
from tactile_core.reconstruction.inference import Reconstructor
from tests.core.small_run import TRAINED

NAME = f"tactile_core:{ENV_ID}"
EVERY = [*REFERENCES, *TRAINED, "recall"]
OF_CANDIDATES = ["uncertainty", "oracle", "gain", "recall"]  # which cast no other rays


@pytest.fixture(autouse=True)
def in_the_home(home, monkeypatch):
    monkeypatch.setenv("TACTILE_HOME", str(home))
    monkeypatch.delenv("TACTILE_STORE", raising=False)


@pytest.fixture
def parts(shapes, unet, reconstructor):
    return {"masks": shapes["test"].masks, "unet": reconstructor}


@pytest.mark.parametrize("name", EVERY)
def test_a_policy_names_the_action_of_the_ray_that_it_would_cast(parts, name):
    env = gym.make(NAME, **parts)
    policy = tactile_core.policy(name, env, seed=3)
    caster = find_policy(name, env.unwrapped.reconstructor)
    rng = policy_rng(caster, 3)
    observation, info = env.reset(seed=0)
    for _ in range(4):
        state = env.unwrapped.episodes.state
        [ray] = caster.choose(state, rng, deterministic=False)
        action = policy.act(observation, info)
        assert env.action_space.contains(action)
        np.testing.assert_array_equal(env.unwrapped.interface.rays(action[None], 64), [ray])
        observation, *_, info = env.step(action)


@pytest.mark.parametrize("name", ["even", "diff", "gain", "recall", "oracle"])
@pytest.mark.parametrize("mode", ["vector_entry_point", "sync"])
def test_it_acts_in_many_environments_at_once_over_their_episodes(parts, name, mode):
    envs = gym.make_vec(NAME, num_envs=2, vectorization_mode=mode, count=3, **parts)
    policy = tactile_core.policy(name, envs, deterministic=True)
    observations, infos = envs.reset(seed=0)
    for _ in range(5):
        actions = policy.act(observations, infos)
        assert envs.action_space.contains(actions)
        observations, *_, infos = envs.step(actions)


@pytest.mark.parametrize("name", OF_CANDIDATES)
def test_candidate_rays_are_actions_of_angle_and_offset_too(parts, name):
    env = gym.make(NAME, **parts, actions="angle and offset", channels=["free space"])
    policy = tactile_core.policy(name, env)
    observation, info = env.reset(seed=1)
    for _ in range(3):
        action = policy.act(observation, info)
        assert env.action_space.contains(action)
        observation, *_, info = env.step(action)


def test_a_ray_that_the_actions_cannot_name_is_told(parts):
    env = gym.make(NAME, **parts, actions="angle and offset")
    policy = tactile_core.policy("random", env)
    with pytest.raises(TactileError, match='take actions="alpha and beta"'):
        policy.act(*env.reset(seed=0))


def test_without_an_environment_it_acts_in_the_one_without_arguments():
    env = gym.make(NAME)
    policy = tactile_core.policy("gain")
    observation, info = env.reset(seed=0)
    assert env.action_space.contains(policy.act(observation, info))


def test_the_oracle_s_first_ray_is_the_best_of_all(parts):
    """It reads the mask from the info that it is given."""
    after = {}
    for name in EVERY:
        env = gym.make(NAME, **parts)
        observation, info = env.reset(options={"mask": 2})
        after[name] = env.step(tactile_core.policy(name, env).act(observation, info))[4]["jaccard"]
    assert max(after, key=lambda name: after[name] if name in OF_CANDIDATES else 0) == "oracle"


def test_the_seed_decides_the_rays_that_are_drawn(parts):
    env = gym.make(NAME, **parts)
    start = env.reset(seed=0)
    drawn = [tactile_core.policy("diff", env, seed=seed).act(*start).tolist() for seed in (1, 1, 2)]
    assert drawn[0] == drawn[1] != drawn[2]


def test_the_rays_that_are_drawn_do_not_tell_which_shape_the_same_seed_hides(parts):
    env = gym.make(NAME, **{**parts, "masks": np.repeat(parts["masks"], 20, axis=0)})
    places, rays = [], []
    for seed in range(60):
        observation, info = env.reset(seed=seed)
        places.append(info["mask"])
        rays.append(tactile_core.policy("random", env, seed=seed).act(observation, info)[0])
    assert abs(np.corrcoef(places, rays)[0, 1]) < 0.6


def test_a_policy_acts_beside_an_environment_of_stable_baselines(parts):
    actor = tactile_core.policy("even", make_sb3_env(2, **parts))
    single = gym.make(NAME, **parts)
    assert actor.act(*single.reset(seed=0)).shape == (2,)


def test_an_unknown_policy_is_told_with_those_that_are_there(parts):
    env = gym.make(NAME, **parts)
    with pytest.raises(TactileError, match=r"'recal' is unknown: choose from random.*gain, recall"):
        tactile_core.policy("recal", env)


def test_a_policy_of_another_unet_is_refused_in_one_sentence(parts, unet):
    weights = {name: 2 * values for name, values in unet.weights.items()}
    other = Reconstructor(dataclasses.replace(unet, weights=weights), precision="float32")
    env = gym.make(NAME, **{**parts, "unet": other})
    with pytest.raises(TactileError, match="trained with another U-Net"):
        tactile_core.policy("recall", env)
    tactile_core.policy("even", env).act(*env.reset(seed=0))


def test_a_reset_of_some_environments_alone_does_not_tell_enough(parts):
    envs = gym.make_vec(NAME, num_envs=2, **parts)
    envs.reset(seed=0)
    seen, infos = envs.reset(options={"reset_mask": np.array([True, False])})
    with pytest.raises(TactileError, match="reset all environments"):
        tactile_core.policy("even", envs).act(seen, infos)
