"""Trained policies as files: the one place that writes and reads them."""

import io
import json
from collections.abc import Iterable
from typing import Any

import safetensors.torch
from safetensors import SafetensorError
from stable_baselines3 import PPO
from upath import UPath

from tactile_core.errors import TactileError
from tactile_core.exploration.policies.base import Policy
from tactile_core.exploration.policies.ppo import PPOPolicy
from tactile_core.exploration.policies.recall import RecallPolicy, load_known_shapes
from tactile_core.exploration.policies.scorer import RayScorer, ScorerPolicy
from tactile_core.reconstruction.inference import best_device
from tactile_core.reconstruction.known_shapes import PACKED_SHAPES

PPO_FILE = "policy.zip"
SCORER_FILE = "policy.safetensors"


def load_policies(directories: Iterable[UPath], resolution: int) -> list[Policy]:
    """The policies stored in each of `directories`: the trained one and, where that is a ray
    scorer, `recall` as well, which needs no training of its own.

    Raises `TactileError` where one is missing, damaged or made for another resolution.
    """
    return [policy for directory in directories for policy in stored_in(directory, resolution)]


def stored_in(directory: UPath, resolution: int) -> list[Policy]:
    try:
        description = json.loads((directory / "settings.json").read_bytes())
        stored = (directory / (SCORER_FILE if is_scorer(description) else PPO_FILE)).read_bytes()
        load = scorer_policies if is_scorer(description) else ppo_policies
        policies = load(description, stored)
        trained_at = description["resolution"]
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


def scorer_policies(description: dict[str, Any], stored: bytes) -> list[Policy]:
    tensors = safetensors.torch.load(stored)
    known = load_known_shapes(
        tensors.pop(PACKED_SHAPES).numpy().tobytes(), description["resolution"]
    )
    net = RayScorer().to(best_device()).eval()
    net.load_state_dict(tensors)
    approach, seed = description["approach"], description["seed"]
    recall = "recall" if approach == "gain" else f"recall_{approach}"
    return [ScorerPolicy(approach, seed, net), RecallPolicy(recall, seed, net, known)]


def ppo_policies(description: dict[str, Any], stored: bytes) -> list[Policy]:
    model = PPO.load(io.BytesIO(stored), device=best_device())
    model.policy.set_training_mode(False)
    return [PPOPolicy(description["approach"], description["seed"], model)]


def is_scorer(description: dict[str, Any]) -> bool:
    """Whether the stored policy is a ray scorer; else it is a PPO."""
    return bool(description["learner"] == "gains")
