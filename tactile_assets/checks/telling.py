"""What the checks of all wings have in common."""

from collections.abc import Iterable

import dagster as dg

from tactile_assets.config import PROFILE

# Trained for a few seconds, nothing has to be good yet.
UNLESS_SMOKE = (
    dg.AssetCheckSeverity.WARN if PROFILE.name == "smoke" else dg.AssetCheckSeverity.ERROR
)


def first(names: Iterable[str]) -> str:
    """The first few names, for a reader to begin with."""
    return ", ".join(list(names)[:5]) or "none"
