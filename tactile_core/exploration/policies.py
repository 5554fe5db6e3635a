"""Policies: whatever chooses the next ray. Here the trained ones, read back from their files."""

import io
import json
from typing import Any, Protocol

import numpy as np
import safetensors.torch
import torch
from safetensors import SafetensorError
from stable_baselines3 import PPO
from upath import UPath

from tactile_core.errors import TactileError
from tactile_core.exploration.circle import report_order
from tactile_core.exploration.rays import candidate_rays
from tactile_core.exploration.scorer import RayScorer, ray_values, scorer_images
from tactile_core.exploration.state import Explorations
from tactile_core.reconstruction.inference import best_device

PPO_FILE = "policy.zip"
SCORER_FILE = "policy.safetensors"


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
        candidates = candidate_rays(explorations.resolution).reshape(-1, 2)
        values = ray_values(self.net, scorer_images(explorations), explorations.rays)
        return candidates[values.argmax(axis=1)]


def load_policy(directory: UPath, resolution: int) -> Policy:
    """The policy stored in `directory`; raises `TactileError` where it is missing, damaged or
    made for another resolution."""
    try:
        about = json.loads((directory / "settings.json").read_bytes())
        stored = (directory / (SCORER_FILE if is_scorer(about) else PPO_FILE)).read_bytes()
        policy = scorer_policy(about, stored) if is_scorer(about) else ppo_policy(about, stored)
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
    return policy


def scorer_policy(about: dict[str, Any], stored: bytes) -> Policy:
    net = RayScorer().to(best_device()).eval()
    net.load_state_dict(safetensors.torch.load(stored))
    return ScorerPolicy(about["approach"], about["seed"], net)


def ppo_policy(about: dict[str, Any], stored: bytes) -> Policy:
    model = PPO.load(io.BytesIO(stored), device=best_device())
    model.policy.set_training_mode(False)
    return PPOPolicy(about["approach"], about["seed"], model)


def is_scorer(about: dict[str, Any]) -> bool:
    """Whether the stored policy is a ray scorer; else it is a PPO."""
    return bool(about["learner"] == "gains")
