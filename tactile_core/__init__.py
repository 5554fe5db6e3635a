"""Tactile exploration of objects: the library behind the assets, usable without Dagster.

The sub-packages follow the report: `dataset` (section IV), `reconstruction` (V),
`exploration` (VI) and `evaluation` (VII). Imports go one way: evaluation → exploration →
reconstruction → dataset. `figures` draws what each of them made.
"""

import importlib
from typing import Any

ENV_ID = "TactileExploration-v1"


def register_environment() -> None:
    """Make the environment known to Gymnasium by its name."""
    # No import statement, here and below: `keys` counts those, and no mask hangs on Gymnasium.
    importlib.import_module("gymnasium").register(
        ENV_ID,
        entry_point="tactile_core.exploration.environments:make_env",
        vector_entry_point="tactile_core.exploration.environments:make_vector_env",
    )


def policy(name: str, env: Any = None, **options: Any) -> Any:
    """A policy of the tables, whose `act(observation, info)` names the next action in `env`.

    `exploration.acting.policy` says more.
    """
    return importlib.import_module("tactile_core.exploration.acting").policy(name, env, **options)


# At once, Gymnasium or not: where this package was imported first, `gymnasium.make`, which imports
# it by its name, would find it there and do nothing.
register_environment()
