"""The report's environment the plain way: one robot, lines by scikit-image, one U-Net pass a ray.

What the environments of `exploration.world` are held to, for rewards and observations in the tests
and for speed here.
"""

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from skimage.draw import line

from tactile_core.exploration.world.circle import report_circle
from tactile_core.exploration.world.rays import MISS, RAY_LIMIT, RAYS
from tactile_core.exploration.world.rewards import DIFF, Stage
from tactile_core.exploration.world.state import Cast, to_grey
from tactile_core.reconstruction.inference import Reconstructor
from tactile_core.reconstruction.jaccard import jaccard_index


class PlainEnv(gym.Env[np.ndarray, np.ndarray]):
    """`TactileEnv` with its default arguments, easy to check by eye."""

    def __init__(
        self,
        masks: np.ndarray,
        reconstructor: Reconstructor,
        stage: Stage = DIFF,
        *,
        count: int = RAYS,
        ray_limit: int = RAY_LIMIT,
    ) -> None:
        resolution = masks.shape[-1]
        self.masks = masks
        self.reconstructor = reconstructor
        self.stage = stage
        self.count = count
        self.ray_limit = ray_limit
        self.circle = report_circle(resolution)
        self.action_space = spaces.MultiDiscrete([len(self.circle)] * 2)
        self.observation_space = spaces.Box(0, 255, (2, resolution, resolution), np.uint8)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        super().reset(seed=seed)
        self.index = int(self.np_random.integers(len(self.masks)))
        self.mask = self.masks[self.index]
        self.touches = np.zeros(self.mask.shape, np.uint8)
        self.felt = np.zeros(self.mask.shape, np.int8)
        self.prediction = self.reconstructor.predict(self.felt[None])[0]
        self.jaccard = float(jaccard_index(self.prediction, self.mask))
        self.rays = 0
        return self.observe(), {"mask": self.index, "jaccard": self.jaccard}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        alpha, beta = self.circle[np.asarray(action)]
        rows, columns = line(*map(int, (*alpha, *beta)))
        met = np.flatnonzero(self.mask[rows, columns])
        touch = (int(rows[met[0]]), int(columns[met[0]])) if len(met) else (MISS, MISS)
        missed = not len(met)
        repeated = not missed and bool(self.touches[touch])
        before = self.jaccard if self.rays else 0.0
        self.rays += 1
        if self.reconstructor.free_space:
            passed = met[0] if len(met) else None
            self.felt[rows[:passed], columns[:passed]] = -1
        if not missed:
            self.touches[touch] = self.felt[touch] = 1
        self.prediction = self.reconstructor.predict(self.felt[None])[0]
        self.jaccard = float(jaccard_index(self.prediction, self.mask))
        cast = Cast(
            touches=np.array([touch], np.int16),
            missed=np.array([missed]),
            repeated=np.array([repeated]),
            jaccard_before=np.array([before], np.float32),
            jaccard=np.array([self.jaccard], np.float32),
        )
        terminated, truncated = self.ended()
        info = {
            "mask": self.index, "jaccard": self.jaccard, "touch": touch,
            "missed": missed, "repeated": repeated,
        }  # fmt: skip
        return self.observe(), float(self.stage.reward(cast)[0]), terminated, truncated, info

    def ended(self) -> tuple[bool, bool]:
        """Whether the episode is terminated, and whether it is truncated."""
        if self.stage.ends == "rays":
            return self.rays >= self.count, False
        terminated = int(self.touches.sum()) >= self.count
        return terminated, not terminated and self.rays >= self.ray_limit

    def observe(self) -> np.ndarray:
        return np.stack([to_grey(self.prediction), self.touches * np.uint8(255)])
