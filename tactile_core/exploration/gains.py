"""Learning what each ray gains: many labels for every state, from shapes that are known.

On the train shapes the first touch of every candidate ray is known. So a state needs no trial
and error: the U-Net is asked what several of the possible touches would add, and a
`RayScorer` learns those gains by regression. A miss or a repeat gains nothing, for free.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch
from torch import nn
from torch.utils.tensorboard import SummaryWriter

from tactile_core.checkpoints import load_checkpoint, save_checkpoint
from tactile_core.dataset.shapes import Shapes
from tactile_core.exploration.rays import candidate_rays
from tactile_core.exploration.scorer import RayScorer, ray_values, score, scorer_images
from tactile_core.exploration.state import Explorations
from tactile_core.reconstruction.inference import Reconstructor, best_device
from tactile_core.reconstruction.jaccard import jaccard_index
from tactile_core.settings import PolicySettings

RAYS = 10  # in an episode
REPLAY = 8192  # states kept to learn from
REPLAY_ARRAYS = ("images", "rays", "gains", "known")
UPDATE_STATES = 64
CURVE = ("loss", "reward", "jaccard", "touches")
# One unit of value at the first ray, in Jaccard points. Later rays add less, about as one over
# their number, and their unit shrinks with it: else the net would learn only the first ones.
POINTS = 15.0
ITERATIONS_PER_CHECKPOINT = 50
# Most candidate rays miss or repeat; at full weight they would drown what there is to gain.
WASTED_WEIGHT = 0.2


class Replay:
    """The last `REPLAY` states, with what the U-Net said about their rays.

    images : (S, 3, R, R) uint8; rays : (S,) int
    gains : (S, C) float32, Jaccard points; known : (S, C) bool, which of them were found out
    """

    def __init__(self, resolution: int, candidates: int) -> None:
        self.images = np.zeros((REPLAY, 3, resolution, resolution), np.uint8)
        self.rays = np.zeros(REPLAY, int)
        self.gains = np.zeros((REPLAY, candidates), np.float32)
        self.known = np.zeros((REPLAY, candidates), bool)
        self.seen = 0

    def add(
        self, images: np.ndarray, rays: np.ndarray, gains: np.ndarray, known: np.ndarray
    ) -> None:
        slots = np.arange(self.seen, self.seen + len(images)) % REPLAY
        self.images[slots], self.rays[slots] = images, rays
        self.gains[slots], self.known[slots] = gains, known
        self.seen += len(images)

    def state(self) -> dict[str, Any]:
        """What was added: most of the arrays may still be empty, and they are large."""
        filled = min(self.seen, REPLAY)
        arrays = {name: getattr(self, name)[:filled] for name in REPLAY_ARRAYS}
        return {"seen": self.seen, "arrays": arrays}

    def load_state(self, saved: dict[str, Any]) -> None:
        """Go on from what `state` returned."""
        self.seen = saved["seen"]
        for name, array in saved["arrays"].items():
            getattr(self, name)[: len(array)] = array

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """Slots of `UPDATE_STATES` states, uniformly."""
        return rng.integers(min(self.seen, REPLAY), size=UPDATE_STATES)


def find_gains(
    explorations: Explorations, tries: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """What candidate rays would add to the Jaccard index: gains (N, C) float32 in points and
    which of them are known, (N, C) bool.

    The U-Net is asked about `tries` of each exploration's possible new touches, by one ray each.
    Where it sees touches only, every ray that leads to one of them shares its gain, and rays that
    miss or repeat are known to gain 0. Where it sees free space, the way there matters as well: it
    is asked about half as many rays that miss or repeat, and only the rays tried are known.
    """
    owners, rays, hits, touches = explorations.try_candidates()
    new = touches >= 0
    some = rng.permutation(np.flatnonzero(new))
    ways = some[np.unique(touches[some], return_index=True)[1]]  # a ray for each new touch
    tried = ways[first_of_each(owners[ways], rng.permutation(len(ways)), tries)]
    free_space = explorations.reconstructor.free_space
    if free_space:
        wasted = np.flatnonzero(~new)
        order = rng.permutation(len(wasted))
        others = wasted[first_of_each(owners[wasted], order, tries // 2)]
        tried = np.concatenate([tried, others])
    felt = explorations.felt_after(owners[tried], rays[tried], hits[tried])
    predictions = explorations.reconstructor.predict(felt)
    gain = jaccard_index(predictions, explorations.masks[owners[tried]])
    gain -= explorations.jaccard[owners[tried]]
    gains, known = np.zeros(len(rays), np.float32), ~new
    if free_space:
        gains[tried], known = gain, np.isin(np.arange(len(rays)), tried)
    elif len(tried):
        place = np.searchsorted(touches[tried], touches).clip(max=len(tried) - 1)
        shared = new & (touches[tried][place] == touches)
        gains[shared], known = gain[place[shared]], known | shared
    count = len(explorations)
    return gains.reshape(count, -1), known.reshape(count, -1)


def first_of_each(owner: np.ndarray, order: np.ndarray, most: int) -> np.ndarray:
    """Of indices taken in `order`, the first `most` of each owner, (T,) int, sorted."""
    by_owner = order[np.argsort(owner[order], kind="stable")]
    starts = np.searchsorted(owner[by_owner], owner[by_owner])
    return np.sort(by_owner[np.arange(len(by_owner)) - starts < most])


def train_scorer(
    title: str,
    seed: int,
    train: Shapes,
    reconstructor: Reconstructor,
    settings: PolicySettings,
    *,
    key: str,
    work: Path,
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
    with SummaryWriter(str(work / "tensorboard")) as writer:
        while learner.iteration < settings.gain_iterations:
            learner.iterate()
            if learner.iteration % max(1, settings.gain_iterations // 20) == 0:
                row = learner.report()
                for name in ("loss", "reward", "jaccard", "touches"):
                    writer.add_scalar(f"gain/{name}", row[name], row["steps"])
                progress(
                    f"{title}: {learner.iteration}/{settings.gain_iterations} iterations, gain "
                    f"{row['reward']:.2f} a ray, Jaccard {row['jaccard']:.1f} after {RAYS}"
                )
            if learner.iteration % ITERATIONS_PER_CHECKPOINT == 0:
                save_checkpoint(checkpoint, key, learner.state())
    return learner.net, pd.DataFrame(learner.curve)


class GainLearner:
    """A scorer in training: explorations under way, what they taught, and the net."""

    def __init__(
        self, seed: int, train: Shapes, reconstructor: Reconstructor, settings: PolicySettings
    ) -> None:
        torch.manual_seed(seed)
        self.settings = settings
        self.rng = np.random.default_rng(seed)
        self.device = best_device()
        self.masks = np.concatenate([train.masks, train.masks[:, :, ::-1]])
        self.candidates = candidate_rays(train.resolution).reshape(-1, 2)
        self.net = RayScorer().to(self.device)
        self.optimizer = torch.optim.AdamW(self.net.parameters(), weight_decay=1e-4)
        self.schedule = torch.optim.lr_scheduler.OneCycleLR(
            self.optimizer,
            settings.gain_learning_rate,
            total_steps=settings.gain_iterations * settings.gain_updates,
            pct_start=0.05,
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
        return self.masks[self.rng.integers(len(self.masks), size=count)]

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
        values = score(self.net, self.replay.images[slots], self.replay.rays[slots])
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
