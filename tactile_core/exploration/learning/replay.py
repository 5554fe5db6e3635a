"""What a ray scorer learns from: the last states it was in, and what their rays would gain."""

from typing import Any

import numpy as np

REPLAY = 8192  # states kept to learn from
REPLAY_ARRAYS = ("images", "rays", "gains", "known")
UPDATE_STATES = 64


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
