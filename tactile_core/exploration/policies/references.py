"""Reference policies: rules that need no training. A rule in `REFERENCES` stands in all tables.

Their names are known without PyTorch; the rules themselves are in `rules`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactile_core.errors import TactileError

if TYPE_CHECKING:
    from tactile_core.exploration.world.state import Explorations

Rule = Callable[["Explorations", np.random.Generator], np.ndarray]


@dataclass(frozen=True)
class ReferencePolicy:
    """A rule that needs no training. It ignores `deterministic`."""

    name: str
    rule: Rule
    seed: int = 0
    draws: bool = False
    version: str = ""

    def choose(
        self, explorations: "Explorations", rng: np.random.Generator, deterministic: bool = True
    ) -> np.ndarray:
        return self.rule(explorations, rng)


def ours(name: str) -> ReferencePolicy:
    """The rule of that name in `rules`, which is imported when it is first asked for a ray."""

    def rule(explorations: "Explorations", rng: np.random.Generator) -> np.ndarray:
        from tactile_core.exploration.policies import rules

        return getattr(rules, name)(explorations, rng)

    return ReferencePolicy(name, rule)


REFERENCES = {name: ours(name) for name in ("random", "even", "coverage", "uncertainty", "oracle")}


def find_reference(name: str) -> ReferencePolicy:
    """The reference policy of that name; raises `TactileError` naming the known ones."""
    if name not in REFERENCES:
        raise TactileError(
            f"reference policy {name!r} is unknown: choose from {', '.join(REFERENCES)}"
        )
    return REFERENCES[name]
