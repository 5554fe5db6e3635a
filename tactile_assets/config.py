"""Run configuration: the settings of the core, with the active profile's values as defaults.

`TACTILE_PROFILE` is read once, when the definitions are loaded.
"""

import copy
from collections.abc import Callable
from typing import Any, TypeVar

import dagster as dg
from pydantic import ValidationError, create_model

from tactile_core.errors import TactileError
from tactile_core.files import content_hash
from tactile_core.settings import Settings, active_profile

PROFILE = active_profile()

AnyConfig = TypeVar("AnyConfig", bound=dg.Config)


class StageConfig(dg.Config):
    """Run config that says in one line what is wrong with it.

    Mixed with the settings of a stage it has their fields, bounds and descriptions, and may be
    passed wherever the core takes those settings.
    """

    def __init__(self, **values: Any) -> None:
        try:
            super().__init__(**values)
        except ValidationError as error:
            problems = [
                f"{'.'.join(map(str, problem['loc']))} = {problem['input']!r}: {problem['msg']}"
                for problem in error.errors()
            ]
            raise TactileError("; ".join(problems)) from error


def defaults(settings: Settings) -> Callable[[type[AnyConfig]], type[AnyConfig]]:
    """Class decorator: the fields of a config class take their defaults from `settings`."""

    def with_defaults(config: type[AnyConfig]) -> type[AnyConfig]:
        fields: dict[str, Any] = {}
        for name, field in type(settings).model_fields.items():
            own = copy.copy(field)
            own.default = getattr(settings, name)
            fields[name] = (field.annotation, own)
        return create_model(
            config.__name__,
            __base__=config,
            __doc__=config.__doc__,
            __module__=config.__module__,
            **fields,
        )

    return with_defaults


def code_version(revision: int, *settings: Settings) -> str:
    """Version of a stage: raised by hand when its code changes, and by itself with its settings.

    A changed code version marks the asset stale, and nothing upstream of it.
    """
    return f"{revision}-{content_hash(*(some.model_dump() for some in settings))[:8]}"
