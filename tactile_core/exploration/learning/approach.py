"""What an approach is: a training recipe (report, section VI.B). `approaches` lists them.

They stand apart: one more approach in the list leaves the trainings of all others as they are.
"""

from dataclasses import dataclass
from typing import Literal, get_args

from tactile_core.errors import TactileError
from tactile_core.exploration.world.rewards import Stage
from tactile_core.value_versions import value_version

Learner = Literal["ppo", "gains", "sequence"]


@dataclass(frozen=True)
class Approach:
    """A named training recipe: PPO through `stages`, learning the gains of rays, or
    looking for a fixed sequence of them."""

    name: str
    description: str
    stages: tuple[Stage, ...] = ()
    learner: Learner = "ppo"

    def __post_init__(self) -> None:
        said = f"approach {self.name!r}"
        if self.learner not in (known := get_args(Learner)):
            raise TactileError(
                f"{said}: learner={self.learner!r} is unknown: choose {', '.join(known)}"
            )
        if not isinstance(self.stages, tuple) or not all(
            isinstance(stage, Stage) for stage in self.stages
        ):
            raise TactileError(f"{said}: its stages are a tuple of Stage, as (Stage(reward),)")
        if bool(self.stages) != (self.learner == "ppo"):
            raise TactileError(f"{said}: PPO trains stages, at least one, and other learners none")

    @property
    def version(self) -> str:
        """The version of its stages and rewards (12 hex digits); words do not count."""
        return value_version((self.name, self.learner, self.stages))
