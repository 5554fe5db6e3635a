"""A fixed sequence: the same rays for every shape, whatever is felt."""

import numpy as np

from tactile_core.exploration.policies.rules import GOLDEN, towards_middle
from tactile_core.exploration.world.state import Explorations
from tactile_core.files import content_hash


class SequencePolicy:
    """Casts `rays` (K, 2) one after the other and, once they are over, a sweep through the middle.

    It tells what adapting is worth: LEBA in Smith et al. 2021 is such a sequence, and beats all
    learned policies there.
    """

    draws = False

    def __init__(self, name: str, seed: int, rays: np.ndarray) -> None:
        self.name = name
        self.seed = seed
        self.rays = rays
        self.version = content_hash(rays.tolist())

    def choose(
        self, explorations: Explorations, rng: np.random.Generator, deterministic: bool
    ) -> np.ndarray:
        cast = explorations.rays  # (N,)
        beyond = towards_middle(2 * np.pi * GOLDEN * cast, explorations.resolution)  # (N, 2)
        own = self.rays[np.minimum(cast, len(self.rays) - 1)]  # (N, 2)
        return np.where((cast < len(self.rays))[:, None], own, beyond)
