"""Code versions: what an asset is computed by. A changed one marks the asset stale."""

from tactile_core import keys
from tactile_core.settings import Settings


def code_version(*parts: str | Settings | None) -> str:
    """The version of code in modules of the core, such as "dataset.splits", with the settings of
    the stage that the profile gives."""
    modules = [part for part in parts if isinstance(part, str)]
    settings = {
        str(number): part.model_dump()
        for number, part in enumerate(parts)
        if isinstance(part, Settings)
    }
    return keys.work_key(*modules, settings=settings)[:12]
