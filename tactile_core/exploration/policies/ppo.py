"""A policy that PPO trained: draws alpha and beta from two heads (report, section VI.B)."""

from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO

from tactile_core.exploration.world.circle import report_order
from tactile_core.exploration.world.state import Explorations


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
