"""The environment as Gymnasium and Stable-Baselines3 know it: made by name, wrapped, in batches."""

import os
import subprocess
import sys
import warnings
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from hypothesis import given, settings
from hypothesis import strategies as st
from stable_baselines3.common.env_checker import check_env as check_for_sb3
from stable_baselines3.common.monitor import Monitor

from tactile_core import ENV_ID
from tactile_core.errors import TactileError
from tactile_core.exploration.environments import make_env, make_sb3_env
from tactile_core.exploration.learning.approaches import APPROACHES
from tactile_core.exploration.world.interface import Interface
from tactile_core.exploration.world.pictures import Window, window_missing
from tactile_core.exploration.world.rewards import TOTAL, Stage
from tactile_core.exploration.world.vec_env import BatchedTactileEnv

NAME = f"tactile_core:{ENV_ID}"
REPOSITORY = Path(__file__).resolve().parents[3]
GRID = Interface("angle and offset")
SOME = {"count": 3, "ray_limit": 5}
seeds = st.integers(0, 2**31 - 1)


@pytest.fixture
def parts(shapes, reconstructor):
    return {"masks": shapes["train"].masks, "unet": reconstructor}


@pytest.mark.parametrize(
    "choice", [{}, {"actions": "angle and offset", "channels": ["free space", "ray number"]}]
)
def test_it_keeps_the_rules_of_gymnasium_and_stable_baselines_without_a_warning(parts, choice):
    env = gym.make(NAME, **parts, **choice)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped)
        check_for_sb3(env.unwrapped)


def test_a_fresh_process_makes_it_without_arguments_from_what_a_run_left(home, shapes):
    """By the code that stands in the README."""
    readme = (REPOSITORY / "README.md").read_text()
    code = readme.split("## Use the environment")[1].split("```python\n")[1].split("```")[0]
    code += "print(info['mask'], len(env.unwrapped.masks), len(envs.episodes.masks), seen.shape)"
    done = in_a_process(code, TACTILE_HOME=str(home))
    test, train = len(shapes["test"]), len(shapes["train"])
    assert done.stdout == f"3 {test} {train} (256, 4, 64, 64)\n", done.stderr


def in_a_process(code: str, **environ: str) -> subprocess.CompletedProcess[str]:
    kept = {key: value for key, value in os.environ.items() if not key.startswith("TACTILE")}
    return subprocess.run(
        ["timeout", "120", sys.executable, "-c", code], env={**kept, **environ}, text=True,
        capture_output=True, check=False, cwd=REPOSITORY,
    )  # fmt: skip


def test_the_package_alone_imports_little():
    light = "import sys, tactile_core; print({'torch', 'pandas', 'ray'} & {*sys.modules})"
    assert in_a_process(light).stdout == "set()\n"


def test_it_is_known_as_well_where_gymnasium_comes_after_the_package():
    code = f"""if True:
        import tactile_core.dataset, gymnasium
        print(gymnasium.spec({ENV_ID!r}).id)
    """
    assert in_a_process(code).stdout == f"{ENV_ID}\n"


def test_the_unet_may_be_a_value_a_path_or_ready_to_predict(home, shapes, unet, reconstructor):
    masks = shapes["test"].masks
    stored = home / "artifacts" / "unet"
    made = [make_env(masks=masks, unet=one) for one in (unet, reconstructor, stored, str(stored))]
    assert {env.reconstructor.version for env in made} == {reconstructor.version}


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"approach": "best"}, "approach 'best' is unknown: choose from diff"),
        ({"approach": "gain"}, "'gain' has no reward"),
        ({"approach": "total_miss", "stage": 3}, "stages 1 to 2, not 3"),
        ({"split": "test"}, "masks= are given"),
        ({"masks": np.zeros((3, 4))}, r"shape \(M, R, R\)"),
        ({"masks": np.full((1, 64, 64), 2)}, "hold 0 and 1"),
        ({"masks": np.zeros((0, 64, 64), bool)}, "at least one"),
        ({"render_mode": "ansi"}, "render_mode='ansi'"),
        ({"actions": "both"}, "alpha and beta or angle and offset"),
        ({"approach": TOTAL, "stage": 1}, "is a stage already"),
        ({"stage": "first"}, "stages 1 to 1, not first"),
        ({"actions": "alpha and beta", "interface": GRID}, "give these or that"),
        ({"count": 0}, "count=0: an episode has a whole number of rays, from 1"),
        ({"count": 2.5}, "count=2.5: an episode has a whole number of rays"),
        ({"chanels": ["free space"]}, "knows no chanels=: there are masks, unet, .* ray_limit"),
        ({"masks": np.zeros((1, 64, 64))}, "mask 0 is empty or leaves the middle half"),
        ({"masks": np.eye(64)[None]}, "rows and columns 16 to 47: scale it"),
    ],
)
def test_what_cannot_be_is_refused_in_one_sentence(parts, wrong, said):
    for make in (gym.make, gym.make_vec):
        with pytest.raises(TactileError, match=said) as refused:
            make(NAME, **{**parts, **wrong})
        assert "\n" not in str(refused.value)


def test_an_approach_brings_the_reward_and_the_end_of_its_stage(parts):
    for number, stage in enumerate(APPROACHES["total_miss"].stages, start=1):
        env = gym.make(NAME, **parts, approach="total_miss", stage=number)
        assert env.unwrapped.episodes.stage == stage


def test_a_stage_of_ones_own_is_taken_under_either_name(parts):
    for name in ("approach", "stage"):
        assert make_env(**parts, **{name: TOTAL}).episodes.stage == TOTAL
    assert make_env(**parts, interface=GRID).interface == GRID


def test_a_reward_that_is_no_number_for_each_exploration_is_refused(parts):
    env = make_env(**parts, approach=Stage(lambda cast: -1.0))
    env.reset(seed=0)
    with pytest.raises(TactileError, match=r"returned an array of shape \(\)"):
        env.step(env.action_space.sample())


def test_reset_takes_the_mask_that_it_is_given(parts):
    env = gym.make(NAME, **parts)
    for mask in (3, 0, 3):
        _, info = env.reset(options={"mask": mask})
        assert info["mask"] == mask
        np.testing.assert_array_equal(info["exploration"]["masks"], parts["masks"][mask])
    for wrong in (
        {"mask": len(parts["masks"])},
        {"mask": -1},
        {"mask": "cup"},
        {"masks": 3},
        {3: 4, "a": 1},
    ):
        with pytest.raises(TactileError, match=r"no mask|know no"):
            env.reset(options=wrong)


def test_render_and_step_before_reset_say_what_is_wrong(parts):
    single = make_env(**parts, render_mode="rgb_array")
    many = gym.make_vec(NAME, num_envs=2, **parts, render_mode="rgb_array")
    for env in (single, many):
        with pytest.raises(gym.error.ResetNeeded, match=r"call reset\(\) before render\(\)"):
            env.render()
        with pytest.raises(gym.error.ResetNeeded, match=r"call reset\(\) before step\(\)"):
            env.step(env.action_space.sample())
    for_sb3 = make_sb3_env(2, **parts)
    with pytest.raises(gym.error.ResetNeeded, match=r"call reset\(\) before step\(\)"):
        for_sb3.step(np.full((2, 2), 3))


@pytest.mark.skipif(not window_missing(), reason="a window can be opened here")
def test_without_a_display_a_window_is_refused(parts):
    with pytest.raises(TactileError, match=r"needs a window .*rgb_array"):
        gym.make(NAME, **parts, render_mode="human")


def test_a_window_shows_one_picture_after_another(monkeypatch):
    monkeypatch.setenv("MPLBACKEND", "agg")
    window = Window()
    for grey in (10, 200):
        window.show(np.full((64, 64, 3), grey, np.uint8))
        shown = np.asarray(window.figure.canvas.buffer_rgba())
        assert shown[shown.shape[0] // 2, shown.shape[1] // 2, 0] == grey
    window.close()


@pytest.mark.parametrize(("approach", "stage"), [("diff", 1), ("total_miss", 1)])
@pytest.mark.parametrize("actions", ["alpha and beta", "angle and offset"])
@settings(deadline=None, max_examples=4)
@given(seed=seeds)
def test_single_gymnasium_s_and_stable_baselines_s_do_the_same(
    shapes, either_reconstructor, approach, stage, actions, seed
):
    """Observations, rewards, ends and info, over several episodes; `SyncVectorEnv` has single
    environments reset in the same step."""
    channels = ("free space", "ray number")
    given = {
        "masks": shapes["train"].masks, "unet": either_reconstructor, "approach": approach,
        "stage": stage, "actions": actions, "channels": channels, **SOME,
    }  # fmt: skip
    singles = SyncVectorEnv(
        [lambda: gym.make(NAME, **given)] * 3, autoreset_mode=AutoresetMode.SAME_STEP
    )
    many = gym.make_vec(NAME, num_envs=3, **given)
    sb3 = BatchedTactileEnv(
        3, given["masks"], either_reconstructor, APPROACHES[approach].stages[stage - 1], **SOME,
        seed=seed, interface=Interface(actions, channels),
    )  # fmt: skip
    assert many.single_observation_space == singles.single_observation_space
    assert many.action_space == singles.action_space
    assert many.metadata["autoreset_mode"] == AutoresetMode.SAME_STEP
    expected, got = singles.reset(seed=seed), many.reset(seed=seed)
    assert_alike(got, expected)
    assert_alike(sb3.reset(), expected[0])
    many.action_space.seed(seed)
    for _ in range(12):
        actions_taken = many.action_space.sample()
        if actions == "angle and offset":  # through the middle, so that something is met
            actions_taken[:, 1] = 5
        expected, got = singles.step(actions_taken), many.step(actions_taken)
        observations, rewards, done, infos = sb3.step(actions_taken)
        assert_alike(got, expected)
        assert_alike(observations, expected[0])
        assert_alike(rewards.astype(float), expected[1])
        np.testing.assert_array_equal(done, expected[2] | expected[3])
        for index in np.flatnonzero(done):
            assert_alike(infos[index]["terminal_observation"], expected[4]["final_obs"][index])


def assert_alike(one, other) -> None:
    """Equal, but for the rounding of a prediction, which hangs on what else is in the batch."""
    if isinstance(other, dict):
        assert one.keys() == other.keys()
        for key in other:
            assert_alike(one[key], other[key])
    elif isinstance(other, tuple) or (other is not None and other.dtype.kind == "O"):
        for mine, yours in zip(one, other, strict=True):
            assert_alike(mine, yours)
    elif other is None:
        assert one is None
    else:
        assert (one.dtype, one.shape) == (other.dtype, other.shape)
        tolerance = {"f": 1e-2, "u": 1}.get(other.dtype.kind, 0)
        np.testing.assert_allclose(one.astype(float), other.astype(float), atol=tolerance)


def test_a_reset_of_some_leaves_the_others(parts):
    env = gym.make_vec(NAME, num_envs=3, **parts)
    env.reset(seed=0)
    env.step(env.action_space.sample())
    rays = env.episodes.state.rays.copy()
    chosen = np.array([False, True, False])
    _, info = env.reset(seed=4, options={"reset_mask": chosen, "mask": 2})
    assert env.episodes.state.rays.tolist() == [rays[0], 0, rays[2]]
    assert info["mask"][1] == 2
    assert info["_mask"].tolist() == chosen.tolist()


def test_the_first_reset_is_of_all(parts):
    env = gym.make_vec(NAME, num_envs=2, **parts)
    with pytest.raises(gym.error.ResetNeeded, match="first reset"):
        env.reset(options={"reset_mask": np.array([True, False])})


def test_seeds_are_told_and_may_be_an_array(parts):
    many = gym.make_vec(NAME, num_envs=3, **parts)
    plain = SyncVectorEnv([lambda: make_env(**parts)] * 3)
    for seed in (5, [7, 8, 7]):
        for env in (many, plain):
            env.reset(seed=seed)
        assert many.np_random_seed == plain.np_random_seed
        assert many.episodes.drawn.tolist() == [env.episodes.drawn[0] for env in plain.envs]
    first, _ = many.reset(seed=[7, 8, 7])
    again, _ = many.reset(seed=np.array([7, 8, 7]))
    np.testing.assert_array_equal(first, again)


def test_the_generators_that_draw_the_masks_can_be_had_and_seeds_stay_as_they_were(parts):
    many = gym.make_vec(NAME, num_envs=2, **parts)
    many.reset(seed=5)
    assert many.np_random == tuple(many.generators)
    assert many.np_random_seed == (5, 6)


@pytest.mark.parametrize("number", [1, 3])
def test_as_many_actions_as_environments_are_asked_for_before_a_ray_is_cast(parts, number):
    many, for_sb3 = gym.make_vec(NAME, num_envs=2, **parts), make_sb3_env(2, **parts)
    for env in (many, for_sb3):
        env.reset()
        with pytest.raises(TactileError, match=f"{number} actions for 2 environments"):
            env.step(np.full((number, 2), 3))
    assert not many.episodes.state.rays.any() and not for_sb3.state.rays.any()


def test_stable_baselines_s_options_choose_the_masks_of_one_reset(parts):
    env = make_sb3_env(3, **parts)
    env.set_options({"mask": 2})
    env.reset()
    assert env.drawn.tolist() == [2, 2, 2]
    env.set_options([{"mask": 1}, {}, {"mask": 0}])
    env.reset()
    assert (env.drawn[0], env.drawn[2]) == (1, 0)
    env.seed(3)
    drawn = [(env.reset(), env.seed(3), tuple(env.drawn))[2] for _ in range(2)]
    assert drawn[0] == drawn[1] and set(drawn[0]) != {2}
    env.set_options({"masks": 2})
    with pytest.raises(TactileError, match="know no 'masks'"):
        env.reset()


def test_pictures_of_many_are_those_of_each(parts):
    many = gym.make_vec(NAME, num_envs=2, **parts, render_mode="rgb_array")
    many.reset(seed=5)
    actions = np.array([[3, 90], [60, 150]])
    many.step(actions)
    for index, shown in enumerate(many.render()):
        one = gym.make(NAME, **parts, render_mode="rgb_array")
        one.reset(seed=5 + index)
        one.step(actions[index])
        np.testing.assert_array_equal(shown, one.render())


def test_a_time_limit_truncates_single_and_many_alike(parts):
    one = gym.make(NAME, **parts, max_episode_steps=2)
    many = gym.make_vec(NAME, num_envs=2, **parts, max_episode_steps=2)
    one.reset(seed=0)
    many.reset(seed=0)
    ends = [one.step(np.array([3, 3]))[2:4] for _ in range(2)]
    assert ends == [(False, False), (False, True)]
    for limit in (0, -2):
        with pytest.raises(TactileError, match="max_episode_steps"):
            gym.make_vec(NAME, num_envs=2, **parts, max_episode_steps=limit)
    without = gym.make_vec(NAME, num_envs=2, **parts, max_episode_steps=-1)
    without.reset(seed=0)
    assert not without.step(np.full((2, 2), 3))[3].any()
    for expected in ends:
        terminated, truncated = many.step(np.full((2, 2), 3))[2:4]
        assert [*zip(terminated.tolist(), truncated.tolist(), strict=True)] == [expected] * 2


def test_wrappers_of_gymnasium_and_stable_baselines_hold(parts, tmp_path):
    many = gym.wrappers.vector.RecordEpisodeStatistics(gym.make_vec(NAME, num_envs=2, **parts))
    many.reset(seed=0)
    for _ in range(10):
        info = many.step(many.action_space.sample())[4]
    assert info["episode"]["l"].tolist() == [10, 10]
    watched = Monitor(gym.make(NAME, **parts), str(tmp_path / "monitor"))
    watched.reset(seed=0)
    for _ in range(10):
        info = watched.step(watched.action_space.sample())[4]
    assert info["episode"]["l"] == 10


def test_videos_are_recorded(parts, tmp_path):
    env = gym.wrappers.RecordVideo(
        gym.make(NAME, **parts, render_mode="rgb_array"),
        str(tmp_path / "videos"),
        disable_logger=True,
    )
    env.reset(seed=0)
    for _ in range(10):
        env.step(env.action_space.sample())
    env.close()
    assert [file.suffix for file in (tmp_path / "videos").iterdir()] == [".mp4"]


def test_processes_forked_off_one_with_several_threads_of_pytorch_do_not_wait_for_them(home):
    code = f"""if True:
        import gymnasium, torch
        torch.set_num_threads(2)
        torch.ones(512, 512) @ torch.ones(512, 512)
        envs = gymnasium.make_vec({NAME!r}, num_envs=2, vectorization_mode="async")
        envs.reset(seed=0)
        print(envs.step(envs.action_space.sample())[0].shape)
        envs.close()
    """
    assert in_a_process(code, TACTILE_HOME=str(home)).stdout == "(2, 2, 64, 64)\n"


def test_environments_in_processes_of_their_own_do_the_same(parts):
    given = {**parts, **SOME}
    apart = gym.make_vec(NAME, num_envs=2, vectorization_mode="async", **given)
    beside = gym.make_vec(NAME, num_envs=2, vectorization_mode="sync", **given)
    try:
        np.testing.assert_equal(apart.reset(seed=1), beside.reset(seed=1))
        apart.action_space.seed(1)
        for _ in range(5):
            actions = apart.action_space.sample()
            for one, other in zip(apart.step(actions), beside.step(actions), strict=True):
                np.testing.assert_equal(one, other)
    finally:
        apart.close()
