"""A policy: whatever chooses the next ray."""

import zlib
from collections.abc import Mapping
from typing import Protocol

import numpy as np
import safetensors.torch
from torch import Tensor

from tactile_core.exploration.world.state import Explorations
from tactile_core.files import content_hash


class Policy(Protocol):
    """Chooses rays for many explorations at once.

    name : as in the tables
    seed : the training seed; 0 where nothing was trained
    draws : whether it draws its rays from a distribution, unless `deterministic`
    version : hash of what it has learnt; empty where nothing was trained
    """

    @property
    def name(self) -> str: ...

    @property
    def seed(self) -> int: ...

    @property
    def draws(self) -> bool: ...

    @property
    def version(self) -> str: ...

    def choose(
        self, explorations: Explorations, rng: np.random.Generator, deterministic: bool
    ) -> np.ndarray:
        """The next ray (alpha, beta) of each exploration, (N, 2) int into `circle_pixels`."""
        ...


def policy_rng(policy: Policy, seed: int, sample: int = 0) -> np.random.Generator:
    """A generator of the policy's own, for test samples from number `sample` on: adding a policy
    does not change the others' rays, nor do these hang on what else was drawn with the seed."""
    return np.random.default_rng([seed, policy.seed, zlib.crc32(policy.name.encode()), sample])


def weights_version(tensors: Mapping[str, Tensor]) -> str:
    """Hash of names, types, shapes and values of tensors (16 hex digits)."""
    return content_hash(safetensors.torch.save(dict(tensors)))
