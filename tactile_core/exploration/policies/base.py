"""A policy: whatever chooses the next ray."""

from typing import Protocol

import numpy as np

from tactile_core.exploration.world.state import Explorations


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
