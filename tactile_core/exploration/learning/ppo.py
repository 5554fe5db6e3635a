"""PPO with CnnPolicy on the batched environment (report, section VI.B), resumable exactly."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure
from upath import UPath

from tactile_core.checkpoints import load_checkpoint, save_checkpoint
from tactile_core.dataset.shapes import Shapes
from tactile_core.exploration.learning.approach import Approach
from tactile_core.exploration.policies.features import READS_THE_WINDOW
from tactile_core.exploration.world.vec_env import BatchedTactileEnv
from tactile_core.progress import teller
from tactile_core.reconstruction.inference import Reconstructor, best_device
from tactile_core.settings import PolicySettings
from tactile_core.tensorboard import curves_folder

RAYS_PER_CHECKPOINT = 8192
# Environment i of a stage draws its masks with the seed plus i; the next stage must draw others.
SEEDS_PER_STAGE = 10_000
# SB3's own Adam, in one pass over all weights: a sixth of an update's time, for 50 rays, less.
ADAM = {"eps": 1e-5, "fused": True}


def train_ppo(
    approach: Approach,
    seed: int,
    train: Shapes,
    reconstructor: Reconstructor,
    settings: PolicySettings,
    *,
    key: str,
    work: Path | UPath,
    progress: Callable[[str], None],
) -> tuple[PPO, pd.DataFrame]:
    """Train all stages of `approach`; returns the policy and its curve.

    The curve has a row for each rollout: stage, steps, reward and rays (means over the
    episodes that ended), jaccard (0–100) and touches at their end.

    `work` holds a checkpoint and TensorBoard curves. A training that was killed and starts
    again with the same `key` goes on from there, to the same policy.
    """
    checkpoint = work / "checkpoint.pt"
    saved = load_checkpoint(checkpoint, key)
    curve: list[dict[str, float]] = saved["curve"] if saved else []
    first = saved["stage"] if saved else 0
    if saved:
        progress(f"{approach.name} seed {seed}: resuming at {saved['steps']} rays")
    model: PPO | None = None
    for number in range(first, len(approach.stages)):
        env = BatchedTactileEnv(
            settings.environments,
            train.packed,
            reconstructor,
            approach.stages[number],
            reward_scale=settings.reward_scale,
            seed=seed + SEEDS_PER_STAGE * number,
        )
        if model is None:
            model = new_model(env, settings, seed)
            folder = curves_folder(work, resumed=bool(saved))
            model.set_logger(configure(str(folder), ["tensorboard"]))
            if saved:
                restore(model, env, saved)
        else:
            model.set_env(env)
        target = (number + 1) * settings.steps_per_stage
        recorder = Recorder(
            f"{approach.name} seed {seed}", number, curve, target, checkpoint, key, progress
        )
        model.learn(max(target - model.num_timesteps, 0), recorder, reset_num_timesteps=False)
    assert model is not None
    return model, pd.DataFrame(curve)


def new_model(env: BatchedTactileEnv, settings: PolicySettings, seed: int) -> PPO:
    """An untrained PPO with the settings of this stage, on the best device."""
    model = PPO(
        "CnnPolicy",
        env,
        policy_kwargs={**READS_THE_WINDOW, "optimizer_kwargs": ADAM},
        learning_rate=settings.learning_rate,
        n_steps=settings.rays_per_rollout,
        batch_size=settings.batch_size,
        n_epochs=settings.epochs,
        ent_coef=settings.entropy,
        gamma=settings.discount,
        seed=seed,
        device=best_device(),
    )
    # A fifth of an update's time less; not sooner, as SB3 draws the weights in the usual layout.
    model.policy.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    return model


class Recorder(BaseCallback):
    """Collects the curve of a training, reports progress and writes checkpoints."""

    def __init__(
        self,
        title: str,
        stage: int,
        curve: list[dict[str, float]],
        target: int,
        checkpoint: Path | UPath,
        key: str,
        progress: Callable[[str], None],
    ) -> None:
        super().__init__()
        self.title = title
        self.stage = stage
        self.curve = curve
        self.target = target
        self.checkpoint = checkpoint
        self.key = key
        self.progress = progress
        self.ended: list[tuple[float, float, float, float]] = []
        self.kept = 0

    def _on_training_start(self) -> None:
        self.kept = self.num_timesteps
        self.tell = teller(self.progress, self.target)

    def _on_step(self) -> bool:
        for info in self.locals["infos"]:
            if "episode" in info:
                episode = info["episode"]
                self.ended.append((episode["r"], episode["l"], info["jaccard"], info["held"]))
        return True

    def _on_rollout_end(self) -> None:
        if not self.ended:
            return
        reward, rays, jaccard, touches = np.mean(self.ended, axis=0)
        self.ended.clear()
        row = {
            "stage": self.stage, "steps": self.num_timesteps, "reward": float(reward),
            "rays": float(rays), "jaccard": float(jaccard), "touches": float(touches),
        }  # fmt: skip
        self.curve.append(row)
        for name in ("reward", "rays", "jaccard", "touches"):
            self.logger.record(f"episode/{name}", row[name])
        self.logger.dump(self.num_timesteps)
        self.tell(
            self.num_timesteps,
            f"{self.title}: {self.num_timesteps}/{self.target} rays, reward {reward:.1f}, "
            f"Jaccard {jaccard:.1f} with {touches:.1f} touches",
        )

    def _on_rollout_start(self) -> None:
        # Here the update from the last rollout is done: the one consistent moment.
        if self.num_timesteps - self.kept >= RAYS_PER_CHECKPOINT:
            self.kept = self.num_timesteps
            model: Any = self.model
            save_checkpoint(
                self.checkpoint, self.key, training_state(self.stage, model, self.curve)
            )


def training_state(stage: int, model: PPO, curve: list[dict[str, float]]) -> dict[str, Any]:
    """Everything that the rest of the training depends on."""
    env = model.env
    assert isinstance(env, BatchedTactileEnv)
    return {
        "stage": stage,
        "steps": model.num_timesteps,
        "curve": curve,
        "policy": model.policy.state_dict(),
        "optimizer": model.policy.optimizer.state_dict(),
        "last_obs": model._last_obs,
        "last_starts": model._last_episode_starts,
        "env": env.get_state(),
        "torch": torch.get_rng_state(),
        "cuda": torch.cuda.get_rng_state_all(),  # empty without a GPU
        "numpy": np.random.get_state(),
    }


def restore(model: PPO, env: BatchedTactileEnv, saved: dict[str, Any]) -> None:
    """Bring a new model and environment to the moment of the checkpoint."""
    model.policy.load_state_dict(saved["policy"])
    model.policy.optimizer.load_state_dict(saved["optimizer"])
    model.num_timesteps = saved["steps"]
    model._last_obs = saved["last_obs"]
    model._last_episode_starts = saved["last_starts"]
    env.set_state(saved["env"])
    torch.set_rng_state(saved["torch"])
    torch.cuda.set_rng_state_all(saved["cuda"])
    np.random.set_state(saved["numpy"])
