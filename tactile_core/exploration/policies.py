"""Policies: whatever chooses the next ray. Here the trained ones, read back from their files."""

import io
import json
from collections.abc import Iterable
from typing import Any, Protocol

import numpy as np
import safetensors.torch
import torch
from safetensors import SafetensorError
from stable_baselines3 import PPO
from upath import UPath

from tactile_core.errors import TactileError
from tactile_core.exploration.circle import report_order
from tactile_core.exploration.recall import known_shapes, try_rays
from tactile_core.exploration.scorer import RayScorer, best_ray, best_rays_apart
from tactile_core.exploration.state import Explorations
from tactile_core.reconstruction.inference import best_device
from tactile_core.reconstruction.known_shapes import KNOWN_SHAPES, KnownShapes

PPO_FILE = "policy.zip"
SCORER_FILE = "policy.safetensors"

TRIED = 16  # rays that `recall` tries, of those of highest value
RECALLED = 12  # known shapes that it tries each of them on
PIXELS_AT_A_TIME = 2**26  # explorations are dealt with in portions, to bound its memory


class Policy(Protocol):
    """Chooses rays for many explorations at once.

    name : as in the tables
    seed : the training seed; 0 where nothing was trained
    """

    @property
    def name(self) -> str: ...

    @property
    def seed(self) -> int: ...

    def choose(
        self, explorations: Explorations, rng: np.random.Generator, deterministic: bool
    ) -> np.ndarray:
        """The next ray (alpha, beta) of each exploration, (N, 2) int into `circle_pixels`."""
        ...


class PPOPolicy:
    """A policy that PPO trained on the report's environment."""

    def __init__(self, name: str, seed: int, model: PPO) -> None:
        self.name = name
        self.seed = seed
        self.model = model

    @torch.no_grad()
    def choose(
        self, explorations: Explorations, rng: np.random.Generator, deterministic: bool
    ) -> np.ndarray:
        observations = torch.from_numpy(explorations.observations()).to(self.model.device)
        distribution = self.model.policy.get_distribution(observations)
        heads: Any = distribution.distribution  # one categorical each for alpha and beta
        logits = [head.logits.cpu().numpy() for head in heads]
        if not deterministic:
            logits = [some + rng.gumbel(size=some.shape) for some in logits]
        actions = np.stack([some.argmax(axis=1) for some in logits], axis=1)
        return report_order(explorations.resolution)[actions]


class ScorerPolicy:
    """A ray scorer: casts the candidate ray of highest value, whether deterministic or not."""

    def __init__(self, name: str, seed: int, net: RayScorer) -> None:
        self.name = name
        self.seed = seed
        self.net = net

    def choose(
        self, explorations: Explorations, rng: np.random.Generator, deterministic: bool
    ) -> np.ndarray:
        return best_ray(self.net, explorations)


class RecallPolicy:
    """Tries the rays of highest value on known shapes that agree with what was felt, and casts the
    one that is best on average."""

    def __init__(self, name: str, seed: int, net: RayScorer, known: KnownShapes) -> None:
        self.name = name
        self.seed = seed
        self.net = net
        self.known = known

    def choose(
        self, explorations: Explorations, rng: np.random.Generator, deterministic: bool
    ) -> np.ndarray:
        portion = max(1, PIXELS_AT_A_TIME // (TRIED * RECALLED * explorations.resolution**2))
        chosen = []
        for start in range(0, len(explorations), portion):
            indices = np.arange(start, min(start + portion, len(explorations)))
            some = explorations.select(indices)
            rays = best_rays_apart(self.net, some, TRIED)
            felt = some.touches.astype(np.int8) - some.free.astype(np.int8)
            expected = try_rays(some, rays, self.known.draw(felt, RECALLED, rng)).mean(axis=2)
            chosen.append(rays[np.arange(len(rays)), expected.argmax(axis=1)])
        return np.concatenate(chosen)


def load_policies(directories: Iterable[UPath], resolution: int) -> list[Policy]:
    """The policies stored in each of `directories`: the trained one and, where that is a ray
    scorer, `recall` as well, which needs no training of its own.

    Raises `TactileError` where one is missing, damaged or made for another resolution.
    """
    return [policy for directory in directories for policy in stored_in(directory, resolution)]


def stored_in(directory: UPath, resolution: int) -> list[Policy]:
    try:
        about = json.loads((directory / "settings.json").read_bytes())
        stored = (directory / (SCORER_FILE if is_scorer(about) else PPO_FILE)).read_bytes()
        load = scorer_policies if is_scorer(about) else ppo_policies
        policies = load(about, stored)
        trained_at = about["resolution"]
    except FileNotFoundError as error:
        raise TactileError(f"{directory} holds no policy: materialise policies first") from error
    except (ValueError, KeyError, RuntimeError, SafetensorError) as error:
        raise TactileError(f"{directory} is damaged: materialise policies again") from error
    if trained_at != resolution:
        raise TactileError(
            f"{directory} was trained at resolution {trained_at}, the U-Net is at "
            f"{resolution}: materialise policies again"
        )
    return policies


def scorer_policies(about: dict[str, Any], stored: bytes) -> list[Policy]:
    tensors = safetensors.torch.load(stored)
    known = known_shapes(tensors.pop(KNOWN_SHAPES).numpy().tobytes(), about["resolution"])
    net = RayScorer().to(best_device()).eval()
    net.load_state_dict(tensors)
    approach, seed = about["approach"], about["seed"]
    recall = "recall" if approach == "gain" else f"recall_{approach}"
    return [ScorerPolicy(approach, seed, net), RecallPolicy(recall, seed, net, known)]


def ppo_policies(about: dict[str, Any], stored: bytes) -> list[Policy]:
    model = PPO.load(io.BytesIO(stored), device=best_device())
    model.policy.set_training_mode(False)
    return [PPOPolicy(about["approach"], about["seed"], model)]


def is_scorer(about: dict[str, Any]) -> bool:
    """Whether the stored policy is a ray scorer; else it is a PPO."""
    return bool(about["learner"] == "gains")
