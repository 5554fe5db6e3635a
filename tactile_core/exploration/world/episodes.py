"""N episodes in step: what the single and both batched environments have in common."""

from collections.abc import Mapping
from typing import Any, TypedDict

import numpy as np

from tactile_core.dataset.packed import Masks, PackedMasks
from tactile_core.errors import TactileError
from tactile_core.exploration.world.interface import Interface
from tactile_core.exploration.world.rays import RAY_LIMIT, RAYS
from tactile_core.exploration.world.rewards import Stage
from tactile_core.exploration.world.state import Cast, Explorations
from tactile_core.reconstruction.inference import Reconstructor


class Options(TypedDict, total=False):
    """What every environment may be told besides masks, U-Net and stage; see `Episodes`."""

    count: int
    ray_limit: int
    interface: Interface


class Episodes:
    """Explorations of masks that are drawn from many, with a reward and an end.

    masks : (M, R, R) bool or packed, those that are drawn from
    stage : the reward, and what ends an episode
    count, ray_limit : an episode is terminated after `count` rays (`stage.ends == "rays"`) or when
        `count` touches are held ("touches"), and in the latter case truncated after `ray_limit`
    interface : action layout and further channels
    drawn : (N,) int, the mask of each episode
    state : the explorations
    """

    def __init__(
        self,
        number: int,
        masks: Masks,
        reconstructor: Reconstructor,
        stage: Stage,
        *,
        count: int = RAYS,
        ray_limit: int = RAY_LIMIT,
        interface: Interface = Interface(),  # noqa: B008 (frozen)
    ) -> None:
        for name, value in (("count", count), ("ray_limit", ray_limit)):
            if not isinstance(value, int | np.integer) or value < 1:
                raise TactileError(f"{name}={value}: an episode has a whole number of rays, from 1")
        self.masks = checked(masks)
        self.stage = stage
        self.count = count
        self.ray_limit = ray_limit
        self.interface = interface
        self.drawn = np.zeros(number, int)
        blank = np.zeros((number, *self.masks.shape[1:]), bool)
        self.state = Explorations(blank, reconstructor)

    @property
    def resolution(self) -> int:
        return self.state.resolution

    def begin(self, which: np.ndarray, drawn: np.ndarray) -> None:
        """New episodes at indices `which`, on the masks at indices `drawn`."""
        self.drawn[which] = drawn
        self.state.restart(which, self.masks[self.drawn[which]])

    def draw(self, generator: np.random.Generator, options: Mapping[str, Any] | None = None) -> int:
        """The mask of a new episode: that of `options`, else any.

        Raises `TactileError` for other options, and where there is no such mask.
        """
        unknown = set(options or {}) - {"mask"}
        if unknown:
            raise TactileError(
                f"reset's options know no {min(unknown, key=str)!r}: there is 'mask'"
            )
        if not options:
            return int(generator.integers(len(self.masks)))
        mask = options["mask"]
        if not isinstance(mask, int | np.integer) or not 0 <= mask < len(self.masks):
            raise TactileError(
                f"there is no mask {mask!r}: they go from 0 to {len(self.masks) - 1}"
            )
        return int(mask)

    def step(self, actions: np.ndarray) -> tuple[Cast, np.ndarray, np.ndarray, np.ndarray]:
        """One ray each, actions (N, 2) int: what it did, rewards (N,) float32, and which episodes
        are terminated or truncated by it, (N,) bool each. Raises `TactileError` where they are not
        as many, before any of them is cast."""
        rays = self.interface.rays(actions, self.resolution)  # (N, 2)
        if len(rays) != len(self.state):
            raise TactileError(
                f"{len(rays)} actions for {len(self.state)} environments: give as many"
            )
        cast = self.state.cast(rays)
        rewards = np.asarray(self.stage.reward(cast), np.float32)
        if rewards.shape != (len(self.state),):
            raise TactileError(
                f"a reward is a number for each of {len(self.state)} explorations, and this one "
                f"returned an array of shape {rewards.shape}"
            )
        return cast, rewards, *self.ended()

    def ended(self) -> tuple[np.ndarray, np.ndarray]:
        if self.stage.ends == "rays":
            return self.state.rays >= self.count, np.zeros(len(self.state), bool)
        terminated = self.state.held >= self.count
        return terminated, ~terminated & (self.state.rays >= self.ray_limit)

    def observations(self, which: np.ndarray | slice = slice(None)) -> np.ndarray:
        """What a policy sees, (N, channels, R, R) uint8."""
        return self.interface.observe(self.state, which)

    def info(self, cast: Cast | None = None) -> dict[str, Any]:
        """What Gymnasium calls info, an array of N of each; see `TactileEnv`."""
        info: dict[str, Any] = {
            "mask": self.drawn.copy(),
            "jaccard": self.state.jaccard.astype(float),
            "exploration": self.state.get_state(),
        }
        if cast is not None:
            info |= {"touch": cast.touches, "missed": cast.missed, "repeated": cast.repeated}
        return info


def checked(masks: Masks) -> Masks:
    """Masks (M, R, R) of 0 and 1 as bool; raises `TactileError` where they are none, or where one
    is empty or leaves the middle half of the image, where rays are cast and the U-Net looks."""
    if isinstance(masks, PackedMasks):
        return masks
    masks = np.asarray(masks)
    if masks.ndim != 3 or not len(masks) or masks.shape[1] != masks.shape[2]:
        raise TactileError(f"masks are of shape (M, R, R), at least one; these are {masks.shape}")
    if masks.dtype != bool:
        if not np.isin(masks, (0, 1)).all():
            raise TactileError("masks hold 0 and 1; these hold other values")
        masks = masks.astype(bool)
    margin = masks.shape[1] // 4
    within = masks[:, margin : masks.shape[1] - margin, margin : masks.shape[1] - margin]
    inside = within.any(axis=(1, 2)) & (within.sum(axis=(1, 2)) == masks.sum(axis=(1, 2)))
    if not inside.all():
        raise TactileError(
            f"mask {int(np.argmin(inside))} is empty or leaves the middle half of the image, rows "
            f"and columns {margin} to {masks.shape[1] - margin - 1}: scale it to a diagonal of "
            "half the image's width"
        )
    return masks
