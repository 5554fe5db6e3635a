"""What an approach is: a training recipe (report, section VI.B). `approaches` lists them.

They stand apart: one more approach in the list leaves the trainings of all others as they are.
"""

from dataclasses import dataclass
from typing import Literal

from tactile_core.exploration.world.rewards import Stage
from tactile_core.value_versions import value_version


@dataclass(frozen=True)
class Approach:
    """A named training recipe: PPO through `stages`, learning the gains of rays, or
    looking for a fixed sequence of them."""

    name: str
    description: str
    stages: tuple[Stage, ...] = ()
    learner: Literal["ppo", "gains", "sequence"] = "ppo"

    @property
    def version(self) -> str:
        """The version of its stages and rewards (12 hex digits); words do not count."""
        return value_version((self.name, self.learner, self.stages))
