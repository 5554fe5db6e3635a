"""A policy that PPO trained: draws alpha and beta from two heads (report, section VI.B)."""

import functools
from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.policies import ActorCriticCnnPolicy, ActorCriticPolicy, BasePolicy
from torch import Tensor

from tactile_core.exploration.policies.base import weights_version
from tactile_core.exploration.policies.features import READS_THE_WINDOW
from tactile_core.exploration.world.circle import report_order
from tactile_core.exploration.world.interface import Interface
from tactile_core.exploration.world.state import Explorations


def untrained_net(resolution: int) -> ActorCriticCnnPolicy:
    """SB3's CnnPolicy as `learning.ppo` trains it, to load weights into."""
    return ActorCriticCnnPolicy(
        Interface().observation_space(resolution),
        Interface().action_space(resolution),
        lr_schedule=lambda progress: 0.0,  # it is not trained any further
        **READS_THE_WINDOW,
    )


def net_weights(net: ActorCriticPolicy) -> dict[str, Tensor]:
    """Its parameters by name, each once: SB3's state dict names a shared extractor three times."""
    return {name: weights.detach() for name, weights in net.named_parameters()}


def net_with(weights: Mapping[str, Tensor], resolution: int) -> ActorCriticCnnPolicy:
    """The net that `net_weights` was taken from, ready to choose.

    Raises `KeyError` or `RuntimeError` where names or shapes are others.
    """
    net = untrained_net(resolution)
    own = dict(net.named_parameters())
    if set(own) != set(weights):
        raise KeyError("these are not the weights of a policy that PPO trained")
    with torch.no_grad():
        for name, values in own.items():
            values.copy_(weights[name])
    net.set_training_mode(False)
    return net


class PPOPolicy:
    """A policy that PPO trained on the report's environment."""

    draws = True

    def __init__(self, name: str, seed: int, net: ActorCriticPolicy) -> None:
        self.name = name
        self.seed = seed
        self.net = net

    @functools.cached_property
    def version(self) -> str:
        return weights_version(net_weights(self.net))

    @torch.no_grad()
    def choose(
        self, explorations: Explorations, rng: np.random.Generator, deterministic: bool
    ) -> np.ndarray:
        observations = torch.from_numpy(explorations.observations()).to(self.net.device)
        logits = [head.cpu().numpy() for head in self.heads(observations)]
        if not deterministic:
            logits = [some + rng.gumbel(size=some.shape) for some in logits]
        actions = np.stack([some.argmax(axis=1) for some in logits], axis=1)  # (N, 2)
        return report_order(explorations.resolution)[actions]

    def heads(self, observations: Tensor) -> tuple[Tensor, ...]:
        """Logits of alpha and of beta, (N, P) each, of observations (N, 2, R, R).

        `get_distribution` would leave them in the net for a moment, where another thread that
        chooses by the same net would find them.
        """
        extractor: Any = self.net.pi_features_extractor
        features = BasePolicy.extract_features(self.net, observations, extractor)
        logits = self.net.action_net(self.net.mlp_extractor.forward_actor(features))  # (N, 2P)
        return logits.chunk(2, dim=1)
