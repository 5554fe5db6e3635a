"""What a policy is shown of an exploration, and how it names a ray."""

import functools
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from gymnasium import spaces

from tactile_core.errors import TactileError
from tactile_core.exploration.world.circle import frozen, report_order
from tactile_core.exploration.world.rays import candidate_rays
from tactile_core.exploration.world.state import EVERY, Explorations

Actions = Literal["alpha and beta", "angle and offset"]
Channel = Literal["free space", "ray number"]
GREY_PER_RAY = 25  # of the channel "ray number": 250 after ten rays


@dataclass(frozen=True)
class Interface:
    """The report's observation and action by default (section VI.A).

    actions : "alpha and beta", both by index into `circle.report_circle`; or "angle and offset",
        by index into `rays.candidate_rays`: 36 angles, each with 11 parallel rays
    channels : those that an observation has beside reconstruction and touches: "free space", 255
        where a past ray has passed; "ray number", 25 in every pixel for each ray cast, at most 255

    Raises `TactileError` for others.
    """

    actions: Actions = "alpha and beta"
    channels: tuple[Channel, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "channels", tuple(self.channels))
        known = get_args(Channel)
        if self.actions not in get_args(Actions):
            raise TactileError(
                f"actions={self.actions!r} is unknown: choose {' or '.join(get_args(Actions))}"
            )
        if len(set(self.channels)) < len(self.channels) or not set(self.channels) <= set(known):
            raise TactileError(
                f"channels={self.channels!r}: choose from {', '.join(known)}, each once"
            )

    def observation_space(self, resolution: int) -> spaces.Box:
        return spaces.Box(0, 255, (2 + len(self.channels), resolution, resolution), np.uint8)

    def action_space(self, resolution: int) -> spaces.MultiDiscrete:
        return spaces.MultiDiscrete(list(ray_table(self.actions, resolution).shape[:2]))

    def observe(self, explorations: Explorations, which: np.ndarray | slice = EVERY) -> np.ndarray:
        """What a policy sees of the explorations at `which`, (N, 2 + channels, R, R) uint8."""
        seen = explorations.observations(which)  # (N, 2, R, R)
        further = [getattr(self, "_" + name.replace(" ", "_"))(explorations, which)
                   for name in self.channels]  # fmt: skip
        return np.concatenate([seen, *further], axis=1) if further else seen

    def rays(self, actions: np.ndarray, resolution: int) -> np.ndarray:
        """The rays (N, 2), as indices into `circle_pixels`, that actions (N, 2) int name.

        Raises `TactileError` for an action outside of the action space.
        """
        table = ray_table(self.actions, resolution)
        actions = np.asarray(actions)
        if actions.dtype.kind not in "iu" or actions.ndim != 2 or actions.shape[1] != 2:
            raise TactileError(f"an action is two whole numbers, {self.actions}; not {actions!r}")
        if (actions < 0).any() or (actions >= table.shape[:2]).any():
            raise TactileError(
                f"actions go up to {table.shape[0] - 1} and {table.shape[1] - 1} ({self.actions}): "
                f"{actions.min(axis=0).tolist()} to {actions.max(axis=0).tolist()} were given"
            )
        return table[tuple(actions.T)]

    def actions_of(self, rays: np.ndarray, resolution: int) -> np.ndarray:
        """The actions (N, 2) int that name rays (N, 2): what `rays` takes back.

        Raises `TactileError` for a ray that no angle and offset name.
        """
        positions = ray_positions(self.actions, resolution)
        try:
            return np.array([positions[tuple(ray)] for ray in rays.tolist()]).reshape(-1, 2)
        except KeyError as error:
            raise TactileError(
                f"no {self.actions} name the ray between pixels {error.args[0]} of the circle: "
                'take actions="alpha and beta" for a policy that casts any ray'
            ) from error

    @staticmethod
    def _free_space(explorations: Explorations, which: np.ndarray | slice) -> np.ndarray:
        return explorations.free[which][:, None] * np.uint8(255)

    @staticmethod
    def _ray_number(explorations: Explorations, which: np.ndarray | slice) -> np.ndarray:
        grey = np.minimum(explorations.rays[which] * GREY_PER_RAY, 255).astype(np.uint8)
        size = explorations.resolution
        return np.broadcast_to(grey[:, None, None, None], (len(grey), 1, size, size))


@functools.cache
def ray_table(actions: Actions, resolution: int) -> np.ndarray:
    """The ray that each action names, (first, second, 2) int into `circle_pixels`."""
    if actions == "angle and offset":
        return candidate_rays(resolution)
    order = report_order(resolution)
    return frozen(np.stack(np.meshgrid(order, order, indexing="ij"), axis=-1))


@functools.cache
def ray_positions(actions: Actions, resolution: int) -> dict[tuple[int, ...], tuple[int, int]]:
    """The action that names each ray, the first where several do."""
    table = ray_table(actions, resolution)
    places = np.indices(table.shape[:2]).reshape(2, -1).T.tolist()
    positions: dict[tuple[int, ...], tuple[int, int]] = {}
    for ray, (first, second) in zip(table.reshape(-1, 2).tolist(), places, strict=True):
        positions.setdefault(tuple(ray), (first, second))
    return positions
