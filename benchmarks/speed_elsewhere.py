"""Environment steps per second beside an environment for active perception that is not ours.

CircleSquare of ap_gym is the smallest of its tasks: a glimpse of 5×5 pixels moves over an image of
28×28, and no net runs in it. So the row says what the U-Net in ours costs, and nothing of which
task is harder.
"""

from importlib.util import find_spec

from benchmarks.speed_environment import LAPTOP, batched_env, random_steps
from benchmarks.timing import Pace, Row, Work, alternated, at_least


def elsewhere_rows(pace: Pace) -> list[Row]:
    """Random actions in as many environments of each; no row where ap_gym is not installed."""
    if find_spec("ap_gym") is None:
        print("  no row beside ap_gym, which is not installed: pip install -e '.[bench]'")
        return []
    count = LAPTOP.environments
    rates = alternated(random_steps(batched_env(count)), circle_square_steps(count), pace)
    what = f"environment steps, {count} environments, beside ap_gym's CircleSquare"
    return [at_least(what, rates, "steps/s")]


def circle_square_steps(count: int) -> Work:
    """Ten steps of `count` environments with random actions."""
    import ap_gym

    env = ap_gym.make_vec("CircleSquare-v0", num_envs=count)
    env.reset(seed=0)
    actions = [env.action_space.sample() for _ in range(10)]

    def work() -> float:
        for action in actions:
            env.step(action)
        return 10 * count

    return work
