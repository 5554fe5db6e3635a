"""The report's environment (section VI.A): single, batched for Gymnasium and for
Stable-Baselines3, step for step the same."""

import pickle

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from benchmarks.plain_environment import PlainEnv
from tactile_core import ENV_ID
from tactile_core.errors import TactileError
from tactile_core.exploration.learning.approaches import APPROACHES, DIFF, Stage
from tactile_core.exploration.world.circle import middle, report_circle, report_order
from tactile_core.exploration.world.env import TactileEnv
from tactile_core.exploration.world.rewards import diff
from tactile_core.exploration.world.state import Explorations
from tactile_core.exploration.world.vec_env import BatchedTactileEnv
from tactile_core.reconstruction.jaccard import THRESHOLD

STAGES = {
    f"{name} stage {number}": stage
    for name, approach in APPROACHES.items()
    for number, stage in enumerate(approach.stages)
}
ENVIRONMENTS = 3
seeds = st.integers(0, 2**31 - 1)


@pytest.fixture(scope="module")
def env(shapes, reconstructor) -> TactileEnv:
    return gym.make(
        ENV_ID, masks=shapes["train"].masks, unet=reconstructor, render_mode="rgb_array"
    )


def through_the_middle(angle: float) -> np.ndarray:
    """The action (2,) whose ray comes from `angle` and passes the middle."""
    pixels = report_circle(64) - middle(64)
    direction = np.array([np.cos(angle), np.sin(angle)])
    return np.array([(pixels @ direction).argmax(), (pixels @ -direction).argmax()])


def some_action(rng: np.random.Generator) -> np.ndarray:
    """Any action, or one that hits the shape; of those there are eight, so that some repeat."""
    if rng.random() < 0.3:
        return rng.integers(len(report_circle(64)), size=2)
    return through_the_middle(rng.integers(8) * np.pi / 4)


def test_gymnasium_makes_it_by_its_name(env):
    assert env.spec.id == ENV_ID
    assert env.action_space == gym.spaces.MultiDiscrete([176, 176])
    assert env.observation_space == gym.spaces.Box(0, 255, (2, 64, 64), np.uint8)


def test_two_environments_with_one_seed_do_the_same(shapes, reconstructor):
    envs = [TactileEnv(shapes["train"].masks, reconstructor) for _ in range(2)]
    resets = [env.reset(seed=7) for env in envs]
    rng = np.random.default_rng(0)
    for _ in range(25):
        np.testing.assert_equal(resets[0], resets[1])
        action = some_action(rng)
        steps = [env.step(action) for env in envs]
        np.testing.assert_equal(steps[0], steps[1])
        if steps[0][2]:
            resets = [env.reset() for env in envs]


def test_an_episode_begins_on_a_mask_of_the_given_ones_with_no_touch(env, shapes, reconstructor):
    drawn = set()
    for seed in range(200):
        observation, info = env.reset(seed=seed)
        drawn.add(info["mask"])
        assert not observation[1].any()
    np.testing.assert_array_equal(observation[0], np.rint(255 * reconstructor.untouched))
    assert drawn == set(range(len(shapes["train"])))


def test_a_ray_through_the_middle_touches_and_a_second_one_repeats(env, shapes):
    _, start = env.reset(seed=0)
    action = through_the_middle(0.4)
    observation, reward, _, _, info = env.step(action)
    assert (info["missed"], info["repeated"]) == (False, False)
    assert shapes["train"].masks[start["mask"]][tuple(info["touch"])]
    assert np.argwhere(observation[1] == 255).tolist() == [info["touch"].tolist()]
    assert reward == pytest.approx(info["jaccard"])
    again, penalty, _, _, second = env.step(action)
    assert second["repeated"]
    assert penalty == -10
    np.testing.assert_array_equal(again, observation)


def test_a_ray_of_one_pixel_misses(env):
    env.reset(seed=0)
    _, reward, _, _, info = env.step(np.array([5, 5]))
    assert (info["missed"], info["touch"].tolist(), reward) == (True, [-1, -1], -10)


def test_an_episode_ends_after_ten_rays(env):
    env.reset(seed=0)
    ends = [env.step(np.array([3, 3]))[2:4] for _ in range(10)]
    assert ends == 9 * [(False, False)] + [(True, False)]


def test_until_ten_touches_an_episode_goes_on_and_the_ray_limit_truncates_it(shapes, reconstructor):
    stage = Stage(diff, ends="touches")
    env = TactileEnv(shapes["train"].masks, reconstructor, stage, count=3, ray_limit=7)
    env.reset(seed=0)
    assert [env.step(np.array([3, 3]))[2:4] for _ in range(7)][-1] == (False, True)
    env.reset(seed=0)
    steps = [env.step(through_the_middle(angle)) for angle in (0.0, 0.0, 2.0, 4.0)]
    assert [step[2] for step in steps] == [False, False, False, True]
    assert sum(step[1] for step in steps) == pytest.approx(steps[-1][4]["jaccard"], abs=1e-3)


def test_the_picture_shows_mask_prediction_ray_and_touch(env):
    _, start = env.reset(seed=0)
    _, _, _, _, info = env.step(through_the_middle(0.0))
    picture = env.render()
    assert (picture.shape, picture.dtype) == ((64, 64, 3), np.uint8)
    assert picture[tuple(info["touch"])].tolist() == [255, 230, 0]
    row, column = info["touch"]
    assert (picture[row + 1 : 63, column] == 255).all()  # the ray comes from below
    assert not (picture[: row - 1, column] == 255).all(axis=-1).any()
    mask = env.unwrapped.masks[start["mask"]]
    assert picture[mask].mean() > picture[~mask].mean()


def test_without_a_render_mode_there_is_no_picture(shapes, reconstructor):
    env = TactileEnv(shapes["train"].masks, reconstructor)
    env.reset(seed=0)
    assert env.render() is None


@pytest.mark.parametrize("name", STAGES)
@settings(deadline=None, max_examples=6)
@given(seed=seeds)
@example(seed=117835)
def test_the_batched_environment_is_a_plain_one_step_for_step(
    shapes, either_reconstructor, name, seed
):
    """Over several episodes, which end by rays, by touches or truncated."""
    masks, limits = shapes["train"].masks, {"count": 4, "ray_limit": 6}
    batch = BatchedTactileEnv(
        ENVIRONMENTS, masks, either_reconstructor, STAGES[name], seed=seed, **limits
    )
    singles = [PlainEnv(masks, either_reconstructor, STAGES[name], **limits) for _ in range(3)]
    observations = batch.reset()
    for index, single in enumerate(singles):
        observation, _ = single.reset(seed=seed + index)
        assert_seen_alike(observations[index], observation)
    rng = np.random.default_rng(seed)
    returns, slack = np.zeros(ENVIRONMENTS), np.zeros(ENVIRONMENTS)
    for _ in range(20):
        actions = np.stack([some_action(rng) for _ in singles])
        observations, rewards, dones, infos = batch.step(actions)
        for index, single in enumerate(singles):
            before = undecided(single)
            observation, reward, terminated, truncated, info = single.step(actions[index])
            now = undecided(single)
            returns[index] += reward
            slack[index] += 1e-2 + before + now
            assert rewards[index] == pytest.approx(reward, abs=1e-2 + before + now)
            assert dones[index] == (terminated or truncated)
            if not dones[index]:
                assert_seen_alike(observations[index], observation)
                continue
            ended = infos[index]
            assert_seen_alike(ended["terminal_observation"], observation)
            assert ended["TimeLimit.truncated"] == truncated
            assert ended["episode"]["l"] == single.rays
            assert ended["episode"]["r"] == pytest.approx(returns[index], abs=slack[index])
            assert ended["jaccard"] == pytest.approx(info["jaccard"], abs=1e-2 + now)
            assert ended["held"] == single.touches.sum()
            returns[index] = slack[index] = 0
            assert_seen_alike(observations[index], single.reset()[0])


def undecided(single: PlainEnv) -> float:
    """Points of the Jaccard index that the rounding of a grey level may decide: those of pixels
    that are next to the threshold. Three images at once are not rounded as one is."""
    near = np.abs(single.prediction - THRESHOLD) < 1 / 255
    return 100 * np.count_nonzero(near) / np.count_nonzero(single.mask)


def assert_seen_alike(one: np.ndarray, other: np.ndarray) -> None:
    """Equal observations, but for the rounding of a grey level."""
    assert one.dtype == other.dtype == np.uint8
    assert np.abs(one.astype(int) - other.astype(int)).max() <= 1


def test_only_the_learner_sees_scaled_rewards(shapes, reconstructor):
    masks = shapes["train"].masks
    plain, scaled = (
        BatchedTactileEnv(2, masks, reconstructor, DIFF, reward_scale=scale, seed=3)
        for scale in (1.0, 0.01)
    )
    plain.reset()
    scaled.reset()
    rng = np.random.default_rng(0)
    for _ in range(10):
        actions = np.stack([some_action(rng), some_action(rng)])
        _, rewards, _, infos = plain.step(actions)
        _, small, _, same = scaled.step(actions)
        np.testing.assert_allclose(small, rewards / 100, rtol=1e-5)
    assert [info["episode"] for info in infos] == [info["episode"] for info in same]


@settings(deadline=None, max_examples=8)
@given(seed=seeds)
def test_a_batched_environment_goes_on_from_its_stored_state(shapes, reconstructor, seed):
    stage = STAGES["pre_diff_miss stage 0"]
    first, second = (
        BatchedTactileEnv(
            3, shapes["train"].masks, reconstructor, stage, count=3, ray_limit=5, seed=some
        )
        for some in (seed, 0)
    )
    first.reset()
    rng = np.random.default_rng(seed)
    for _ in range(4):
        first.step(np.stack([some_action(rng) for _ in range(3)]))
    second.set_state(first.get_state())
    for _ in range(8):
        actions = np.stack([some_action(rng) for _ in range(3)])
        np.testing.assert_equal(first.step(actions), second.step(actions))


def test_a_stored_state_does_not_change_with_the_environment(shapes, reconstructor):
    env = BatchedTactileEnv(2, shapes["train"].masks, reconstructor, DIFF)
    env.reset()
    state = env.get_state()
    first = env.step(report_order(64)[:4].reshape(2, 2))
    env.step(report_order(64)[4:8].reshape(2, 2))
    env.set_state(state)
    np.testing.assert_equal(env.step(report_order(64)[:4].reshape(2, 2)), first)


def test_seeding_the_batched_environment_repeats_its_masks(shapes, reconstructor):
    env = BatchedTactileEnv(6, shapes["train"].masks, reconstructor, DIFF)
    drawn = []
    for seed in (11, 12, 11):
        env.seed(seed)
        env.reset()
        drawn.append(env.drawn.tolist())
    assert drawn[0] == drawn[2] != drawn[1]
    assert drawn[0][1:] == drawn[1][:-1]  # environment i is seeded with seed + i


@pytest.mark.parametrize("stage", STAGES)
def test_environments_travel_to_other_processes_by_the_standard_library(
    shapes, reconstructor, stage
):
    env = TactileEnv(shapes["train"].masks, reconstructor, STAGES[stage])
    env.reset(seed=3)
    action = through_the_middle(0.3)
    expected = env.step(action)
    again = pickle.loads(pickle.dumps(env))
    again.reset(seed=3)
    np.testing.assert_equal(again.step(action), expected)


def test_masks_of_another_resolution_than_the_unet_s_are_refused(small_shapes, reconstructor):
    masks = small_shapes["train"].masks
    for make in (
        lambda: TactileEnv(masks, reconstructor),
        lambda: BatchedTactileEnv(2, masks, reconstructor, DIFF),
        lambda: Explorations(masks, reconstructor),
    ):
        with pytest.raises(TactileError, match="masks of resolution 48 cannot be explored"):
            make()
