"""The report's rewards (section VI.B), on the Jaccard index in percent; what ends an episode."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from tactile_core.errors import TactileError

if TYPE_CHECKING:  # the names of all approaches are known without PyTorch
    from tactile_core.exploration.world.state import Cast

Reward = Callable[["Cast"], np.ndarray]
Ends = Literal["rays", "touches"]

PENALTY = -10.0


def total(cast: "Cast") -> np.ndarray:
    """The Jaccard index after the ray, (N,) float32."""
    return cast.jaccard


def diff(cast: "Cast") -> np.ndarray:
    """What the ray added to the Jaccard index, (N,) float32; at first the index itself."""
    return cast.jaccard - cast.jaccard_before


@dataclass(frozen=True)
class Penalised:
    """`reward`, but −10 in its place for a ray that misses or repeats a touch.

    No closure: stages travel to other processes with the environments that hold them.
    """

    reward: Reward

    def __call__(self, cast: "Cast") -> np.ndarray:
        wasted = cast.missed | cast.repeated
        return np.where(wasted, np.float32(PENALTY), self.reward(cast))


@dataclass(frozen=True)
class Stage:
    """One training stage: what is rewarded, and what ends an episode.

    ends : "rays": after ten rays; "touches": when ten touches are held (or the ray limit
        is reached, which truncates the episode)
    """

    reward: Reward
    ends: Ends = "rays"

    def __post_init__(self) -> None:
        if not callable(self.reward):
            raise TactileError(f"a stage's reward is a function of a cast, not {self.reward!r}")
        if self.ends not in (known := get_args(Ends)):
            raise TactileError(f"ends={self.ends!r} is unknown: choose {' or '.join(known)}")


DIFF = Stage(Penalised(diff))
TOTAL = Stage(Penalised(total))
