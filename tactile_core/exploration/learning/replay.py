"""What a ray scorer learns from: the last states it was in, and what their rays would gain."""

from typing import Any

import numpy as np

REPLAY = 8192  # states kept to learn from
REPLAY_ARRAYS = ("predictions", "seen_or_felt", "rays", "gains", "known")
UPDATE_STATES = 64


class Replay:
    """The last `REPLAY` states, with what the U-Net said about their rays.

    rays : (S,) int; gains : (S, C) float32, Jaccard points; known : (S, C) bool, which of them
    were found out. The images, (3, R, R) uint8 each as of `scorer_images`, are kept small: of the
    prediction only the middle half, beyond which it is 0, and a bit for each pixel of the others,
    which are 0 or 255.
    """

    def __init__(self, resolution: int, candidates: int) -> None:
        self.resolution = resolution
        self.margin = resolution // 4
        side = resolution - 2 * self.margin
        self.predictions = np.zeros((REPLAY, side, side), np.uint8)
        self.seen_or_felt = np.zeros((REPLAY, 2, resolution**2 // 8), np.uint8)
        self.rays = np.zeros(REPLAY, int)
        self.gains = np.zeros((REPLAY, candidates), np.float32)
        self.known = np.zeros((REPLAY, candidates), bool)
        self.seen = 0

    def add(
        self, images: np.ndarray, rays: np.ndarray, gains: np.ndarray, known: np.ndarray
    ) -> None:
        slots = np.arange(self.seen, self.seen + len(images)) % REPLAY
        inside = slice(self.margin, self.resolution - self.margin)
        self.predictions[slots] = images[:, 0, inside, inside]
        self.seen_or_felt[slots] = np.packbits(images[:, 1:].reshape(len(images), 2, -1), axis=2)
        self.rays[slots], self.gains[slots], self.known[slots] = rays, gains, known
        self.seen += len(images)

    def images(self, slots: np.ndarray) -> np.ndarray:
        """The images of states as they were added, (n, 3, R, R) uint8."""
        found = np.zeros((len(slots), 3, self.resolution, self.resolution), np.uint8)
        inside = slice(self.margin, self.resolution - self.margin)
        found[:, 0, inside, inside] = self.predictions[slots]
        bits = np.unpackbits(self.seen_or_felt[slots], axis=2)  # (n, 2, R²)
        found[:, 1:] = 255 * bits.reshape(len(slots), 2, self.resolution, self.resolution)
        return found

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
