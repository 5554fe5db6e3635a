"""Environment and PPO steps per second, beside one environment that steps alone.

The plain way is `PlainEnv`, lines by scikit-image, under Stable-Baselines3's DummyVecEnv, with
a float32 U-Net in PyTorch at batch 1: the same, with folded normalisation and channels last.
"""

from collections.abc import Sequence

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv

from benchmarks.plain_environment import PlainEnv
from benchmarks.samples import RESOLUTION, masks, untrained
from benchmarks.timing import Curve, Pace, Row, Work, alternated, at_least, swept
from tactile_core.exploration.learning.approaches import DIFF
from tactile_core.exploration.learning.ppo import new_model
from tactile_core.exploration.world.vec_env import BatchedTactileEnv
from tactile_core.profiles import PROFILES
from tactile_core.reconstruction.inference import Reconstructor, best_device

LAPTOP = PROFILES["laptop"].policies
MOST = 256
ENVIRONMENTS = (1, 2, 4, 8, 16, 32, 64, 128, MOST)
RESOLUTIONS = (48, 64, 128, 256)
ROLLOUT, BATCH, EPOCHS = 2000, 50, 10  # PPO as the report's code runs it
LEARNING_RATE, ENTROPY = 3e-5, 0.01


def environment_rows(pace: Pace) -> list[Row]:
    """Steps with random actions: as many environments as the laptop profile has, and many."""
    plain = random_steps(plain_env())
    return [
        at_least(
            f"environment steps, random rays, {count} environments",
            alternated(random_steps(batched_env(count)), plain, pace),
            "steps/s",
            goal=goal,
        )
        for count, goal in ((LAPTOP.environments, 40), (MOST, 70))
    ]


def ppo_rows(pace: Pace) -> list[Row]:
    """PPO training at the laptop settings, beside the report's settings on one environment."""
    env = batched_env(LAPTOP.environments, LAPTOP.reward_scale)
    rollout = 100 if pace.quick else ROLLOUT
    plain = PPO(
        "CnnPolicy", plain_env(), learning_rate=LEARNING_RATE, n_steps=rollout, batch_size=BATCH,
        n_epochs=EPOCHS, ent_coef=ENTROPY, seed=0, device=best_device(),
    )  # fmt: skip
    # Our few seconds should also span several rollouts with their updates.
    rollouts = 1 if pace.quick else 6
    ours = learned_steps(
        new_model(env, LAPTOP, seed=0), rollouts * LAPTOP.rays_per_rollout * env.num_envs
    )
    rates = alternated(ours, learned_steps(plain, rollout), pace, min(pace.repetitions, 3))
    what = "PPO training, laptop settings beside the report's"
    return [at_least(what, rates, "steps/s", goal=15)]


def environment_curves(pace: Pace) -> list[Curve]:
    """Steps with random actions against the number of environments and the resolution."""
    counts = pace.some(ENVIRONMENTS)
    rates = swept([random_steps(batched_env(count)) for count in counts], pace)
    seconds = [count / rate for count, rate in zip(counts, rates, strict=True)]
    resolutions = pace.some(RESOLUTIONS)
    works = [random_steps(batched_env(LAPTOP.environments, resolution=r)) for r in resolutions]
    finer = swept(works, pace)
    return [
        Curve("environment steps", "environments", counts, rates, "steps/s", seconds),
        Curve(
            f"environment steps, {LAPTOP.environments} environments", "resolution", resolutions,
            finer, "steps/s", reciprocals(finer), linear=2,
        ),
    ]  # fmt: skip


def reciprocals(rates: Sequence[float]) -> list[float]:
    return [1 / rate for rate in rates]


def batched_env(
    count: int, reward_scale: float = 1.0, resolution: int = RESOLUTION
) -> BatchedTactileEnv:
    reconstructor = Reconstructor(untrained(resolution))
    return BatchedTactileEnv(
        count, masks(resolution), reconstructor, DIFF, reward_scale=reward_scale
    )


class InPyTorch(Reconstructor):
    """The plain way through the U-Net, on processors as well."""

    @torch.inference_mode()
    def predict(self, felt: np.ndarray) -> np.ndarray:
        return self._forward(felt)


def plain_env() -> DummyVecEnv:
    reconstructor = InPyTorch(untrained(), "float32")
    return DummyVecEnv([lambda: PlainEnv(masks(), reconstructor)])


def random_steps(env: VecEnv) -> Work:
    """Ten steps of every environment with random rays."""
    pixels = env.action_space.nvec[0]  # type: ignore[attr-defined]
    rng = np.random.default_rng(0)
    env.reset()

    def work() -> float:
        for _ in range(10):
            env.step(rng.integers(pixels, size=(env.num_envs, 2)))
        return 10 * env.num_envs

    return work


def learned_steps(model: PPO, steps: int) -> Work:
    """Rollouts of `steps` steps in all, and the updates after each."""

    def work() -> float:
        model.learn(steps, reset_num_timesteps=False)
        return steps

    return work
