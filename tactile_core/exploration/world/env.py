"""The report's environment (section VI.A) for one robot: plain, and easy to check by eye.

Training steps many explorations at once in `vec_env.BatchedTactileEnv`; a test holds the two
to the same rewards and observations.
"""

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from skimage.draw import line

from tactile_core.exploration.world.circle import report_circle
from tactile_core.exploration.world.rays import MISS, RAYS
from tactile_core.exploration.world.rewards import DIFF, Stage
from tactile_core.exploration.world.state import Cast, check_resolution, to_grey
from tactile_core.reconstruction.inference import Reconstructor
from tactile_core.reconstruction.jaccard import THRESHOLD, jaccard_index

ENV_ID = "TactileExploration-v0"


class TactileEnv(gym.Env[np.ndarray, np.ndarray]):
    """Feel out an unknown shape with ten rays.

    ## Action
    `MultiDiscrete([P, P])`: `alpha` and `beta`, two pixels of the circle of radius R/2−1
    around the middle, by index into `circle.report_circle` (P = 176 at R = 64, 720 at 256).
    The ray is the pixel line from alpha to beta; its touch is the first mask pixel on it.

    ## Observation
    `Box(0, 255, (2, R, R), uint8)`

    | channel | content | range |
    |---|---|---|
    | 0 | reconstruction: probability of the object × 255 | 0–255 |
    | 1 | touches held: 255 at each, else 0 | 0 or 255 |

    ## Reward
    `stage.reward` of the cast, see `rewards`: by default what the ray adds to the Jaccard
    index (0–100), and −10 in its place for a miss or a repeat.

    ## Start
    A mask drawn uniformly from `masks`, no touch held.

    ## End
    Terminated after `count` rays (`stage.ends == "rays"`) or when `count` touches are held
    (`"touches"`). Truncated after `ray_limit` rays in the latter case.

    ## Info
    `jaccard` (0–100), `touch` (row, column; −1, −1 for a miss), `missed`, `repeated`, and
    `mask`, the index of the mask.

    ## Arguments
    masks : (M, R, R) bool; reconstructor : the trained U-Net; stage : reward and end.

    ## Version history
    v0: the report's environment.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 2}  # noqa: RUF012

    def __init__(
        self,
        masks: np.ndarray,
        reconstructor: Reconstructor,
        stage: Stage = DIFF,
        *,
        count: int = RAYS,
        ray_limit: int = 100,
        render_mode: str | None = None,
    ) -> None:
        check_resolution(masks, reconstructor)
        resolution = masks.shape[-1]
        self.masks = masks
        self.reconstructor = reconstructor
        self.stage = stage
        self.count = count
        self.ray_limit = ray_limit
        self.render_mode = render_mode
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
        self.last_ray: tuple[np.ndarray, np.ndarray] | None = None
        return self.observe(), {"mask": self.index, "jaccard": self.jaccard}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        alpha, beta = self.circle[np.asarray(action)]
        rows, columns = line(*map(int, (*alpha, *beta)))
        met = np.flatnonzero(self.mask[rows, columns])
        self.last_ray = rows[: met[0] + 1 if len(met) else None], columns
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

    def render(self) -> np.ndarray | None:
        """The mask in grey, the thresholded prediction in pink, the ray in white, touches in
        yellow: (R, R, 3) uint8."""
        if self.render_mode != "rgb_array":
            return None
        picture = np.where(self.mask, 120, 30)[..., None].repeat(3, axis=-1).astype(np.uint8)
        predicted = self.prediction > THRESHOLD
        picture[predicted] = picture[predicted] // 2 + np.array([127, 40, 90], np.uint8)
        if self.last_ray:
            rows, columns = self.last_ray
            picture[rows, columns[: len(rows)]] = 255
        picture[self.touches == 1] = (255, 230, 0)
        return picture


gym.register(ENV_ID, entry_point="tactile_core.exploration.world.env:TactileEnv")
