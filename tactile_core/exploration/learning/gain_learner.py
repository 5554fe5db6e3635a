"""Training a ray scorer: it learns by regression what rays gain, in states of its own making."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch
from torch import nn
from torch.utils.tensorboard import SummaryWriter
from upath import UPath

from tactile_core.checkpoints import load_checkpoint, save_checkpoint
from tactile_core.dataset.shapes import Shapes
from tactile_core.exploration.learning.gains import find_gains
from tactile_core.exploration.learning.replay import Replay
from tactile_core.exploration.policies.scorer import RayScorer, ray_values, score, scorer_images
from tactile_core.exploration.world.rays import RAYS, candidate_rays
from tactile_core.exploration.world.state import Explorations
from tactile_core.progress import teller
from tactile_core.reconstruction.inference import Reconstructor, best_device
from tactile_core.settings import GainSettings
from tactile_core.tensorboard import curves_folder

CURVE = ("loss", "reward", "jaccard", "touches")
# One unit of value at the first ray, in Jaccard points. Later rays add less, about as one over
# their number, and their unit shrinks with it: else the net would learn only the first ones.
POINTS = 15.0
ITERATIONS_PER_CHECKPOINT = 50
# Most candidate rays miss or repeat; at full weight they would drown what there is to gain.
WASTED_WEIGHT = 0.2
WARM_UP = 0.05  # share of the steps over which the learning rate rises
SHORTEST_SCHEDULE = 21  # with 20 steps its warm-up has no length, and PyTorch divides by that


def train_scorer(
    title: str,
    seed: int,
    train: Shapes,
    reconstructor: Reconstructor,
    settings: GainSettings,
    *,
    key: str,
    work: Path | UPath,
    progress: Callable[[str], None],
) -> tuple[RayScorer, pd.DataFrame]:
    """Train a scorer on its own explorations of the train shapes and their mirror images.

    Returns it with its curve, about twenty rows: stage (0), steps (rays cast), loss, reward (mean
    gain of a ray, Jaccard points), jaccard (0–100) and touches at the end of episodes. `work`
    holds a checkpoint: a training that was killed and starts again with the same `key` goes
    on from there, to the same scorer.
    """
    learner = GainLearner(seed, train, reconstructor, settings)
    checkpoint = work / "checkpoint.pt"
    saved = load_checkpoint(checkpoint, key)
    if saved:
        learner.load_state(saved)
        progress(f"{title}: resuming after iteration {learner.iteration}")
    total = settings.gain_iterations
    tell = teller(progress, total)
    with SummaryWriter(str(curves_folder(work, resumed=bool(saved)))) as writer:
        while learner.iteration < total:
            learner.iterate()
            if learner.iteration % max(1, total // 20) == 0:
                row = learner.report()
                for name in CURVE:
                    writer.add_scalar(f"gain/{name}", row[name], row["steps"])
            words = f"{title}: {learner.iteration}/{total} iterations"
            row = learner.curve[-1] if learner.curve else {}
            if np.isfinite(row.get("jaccard", np.nan)):  # an exploration has ended
                words += (
                    f", gain {row['reward']:.2f} a ray, Jaccard {row['jaccard']:.1f} after {RAYS}"
                )
            tell(learner.iteration, words)
            if learner.iteration % ITERATIONS_PER_CHECKPOINT == 0:
                save_checkpoint(checkpoint, key, learner.state())
    return learner.net, pd.DataFrame(learner.curve)


class GainLearner:
    """A scorer in training: explorations under way, what they taught, and the net."""

    def __init__(
        self, seed: int, train: Shapes, reconstructor: Reconstructor, settings: GainSettings
    ) -> None:
        torch.manual_seed(seed)
        self.settings = settings
        self.rng = np.random.default_rng(seed)
        self.device = best_device()
        self.masks = train.packed
        self.candidates = candidate_rays(train.resolution).reshape(-1, 2)
        self.net = RayScorer().to(self.device)
        self.optimizer = torch.optim.AdamW(self.net.parameters(), weight_decay=1e-4)
        steps = settings.gain_iterations * settings.gain_updates
        self.schedule = torch.optim.lr_scheduler.OneCycleLR(
            self.optimizer,
            settings.gain_learning_rate,
            total_steps=max(steps, SHORTEST_SCHEDULE),
            pct_start=WARM_UP,
        )
        count = settings.gain_states
        self.explorations = Explorations(self.draw_masks(count), reconstructor)
        # First episodes of differing lengths: later batches then hold every ray number.
        self.lengths = self.rng.integers(1, RAYS + 1, count)
        self.replay = Replay(train.resolution, len(self.candidates))
        self.curve: list[dict[str, float]] = []
        self.recent: dict[str, list[float]] = {name: [] for name in CURVE}
        self.iteration = 0

    def draw_masks(self, count: int) -> np.ndarray:
        """`count` train shapes, every second of them mirrored on average."""
        mirrored, which = np.divmod(
            self.rng.integers(2 * len(self.masks), size=count), len(self.masks)
        )
        masks = self.masks[which]
        masks[mirrored == 1] = masks[mirrored == 1][:, :, ::-1]
        return masks

    def iterate(self) -> None:
        """One ray in every exploration, its lesson kept, and some gradient steps."""
        explorations, rays = self.explorations, self.explorations.rays.copy()
        images = scorer_images(explorations)
        gains, known = find_gains(explorations, self.settings.gain_tries, self.rng)
        self.replay.add(images, rays, gains, known)
        before = explorations.jaccard.copy()
        explorations.cast(self.candidates[self.choose(images, rays)])
        self.recent["reward"].append(float((explorations.jaccard - before).mean()))
        self.recent["loss"] += [self.update() for _ in range(self.settings.gain_updates)]
        self.restart_ended()
        self.iteration += 1

    def choose(self, images: np.ndarray, rays: np.ndarray) -> np.ndarray:
        """The ray of highest value for each state, or now and then any ray, (N,) int."""
        chosen = ray_values(self.net, images, rays).argmax(axis=1)
        progress = self.iteration / self.settings.gain_iterations
        stray = self.rng.random(len(chosen)) < 0.5 * max(0.1, 1 - 1.5 * progress)
        chosen[stray] = self.rng.integers(len(self.candidates), size=int(stray.sum()))
        return chosen

    def update(self) -> float:
        """One gradient step on states drawn from the replay; returns the loss."""
        slots = self.replay.draw(self.rng)
        values = score(self.net, self.replay.images(slots), self.replay.rays[slots])
        units = POINTS / (1 + self.replay.rays[slots, None])
        gains = torch.from_numpy((self.replay.gains[slots] / units).astype(np.float32))
        gains = gains.to(self.device)
        known = torch.from_numpy(self.replay.known[slots]).to(self.device)
        weights = known * torch.where(gains == 0, WASTED_WEIGHT, 1.0)
        loss = (weights * (values - gains).square()).sum() / weights.sum()
        self.optimizer.zero_grad(set_to_none=True)
        loss.backward()
        nn.utils.clip_grad_norm_(self.net.parameters(), 1.0)
        self.optimizer.step()
        self.schedule.step()
        return loss.item()

    def restart_ended(self) -> None:
        """Note how full episodes ended, and begin anew where one is over."""
        over = np.flatnonzero(self.explorations.rays >= self.lengths)
        full = over[self.lengths[over] == RAYS]
        self.recent["jaccard"] += self.explorations.jaccard[full].tolist()
        self.recent["touches"] += self.explorations.held[full].tolist()
        self.lengths[over] = RAYS
        self.explorations.restart(over, self.draw_masks(len(over)))

    def report(self) -> dict[str, float]:
        """Add a row of means since the last one to the curve, and return it."""
        row = {"stage": 0.0, "steps": self.iteration * len(self.explorations)}
        for name, values in self.recent.items():
            row[name] = float(np.mean(values)) if values else np.nan
            values.clear()
        self.curve.append(row)
        return row

    def state(self) -> dict[str, Any]:
        """Everything that the rest of the training depends on."""
        return {
            "net": self.net.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "schedule": self.schedule.state_dict(),
            "rng": self.rng.bit_generator.state,
            "explorations": self.explorations.get_state(),
            "lengths": self.lengths,
            "replay": self.replay.state(),
            "curve": self.curve,
            "recent": self.recent,
            "iteration": self.iteration,
        }

    def load_state(self, saved: dict[str, Any]) -> None:
        """Go on from what `state` returned."""
        for name in ("net", "optimizer", "schedule"):
            getattr(self, name).load_state_dict(saved[name])
        self.rng.bit_generator.state = saved["rng"]
        self.explorations.set_state(saved["explorations"])
        self.replay.load_state(saved["replay"])
        for name in ("lengths", "curve", "recent", "iteration"):
            setattr(self, name, saved[name])
