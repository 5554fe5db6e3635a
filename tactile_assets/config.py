"""Run configuration: the settings of the core, with the active profile's values as defaults.

The profile is found once, when the definitions are loaded.
"""

import contextlib
import copy
import os
from collections.abc import Callable, Iterable, Mapping
from enum import StrEnum
from typing import Any, TypeVar, get_args, get_origin

import click
import dagster as dg
from pydantic import ConfigDict, ValidationError, create_model
from pydantic.fields import FieldInfo

from tactile_assets.dagster_internals import is_schedule, when_a_run_is_asked_for
from tactile_core.errors import TactileError
from tactile_core.home import remembered_profile
from tactile_core.profiles import Profile, active_profile
from tactile_core.settings import Settings, problems


def profile_or_end() -> Profile:
    """The active profile; where `TACTILE_PROFILE` names none, the process ends in one line.

    Of what an import raises Dagster's commands print the whole stack.
    """
    try:
        return active_profile()
    except TactileError as error:
        raise SystemExit(str(error)) from None


PROFILE = profile_or_end()


def schedule_or_end(environ: Mapping[str, str] = os.environ) -> str | None:
    """What `TACTILE_CRON` says, if anything; what is no schedule ends the process, too."""
    cron = environ.get("TACTILE_CRON") or None
    if cron is None or is_schedule(cron):
        return cron
    raise SystemExit(
        f"TACTILE_CRON={cron!r} is no schedule of five fields: minute, hour, day, month and "
        "weekday, as '0 2 * * *'"
    )


def which_profile(environ: Mapping[str, str] = os.environ) -> str:
    """Which profile is active, and why where nobody named it or the last run here had another."""
    name, last = PROFILE.name, None
    with contextlib.suppress(TactileError):  # it cannot be read: a named one does not need it
        last = remembered_profile(environ)
    if not environ.get("TACTILE_PROFILE"):
        why = "as in the last run here" if last else "as none was named"
        return f"profile {name}, {why}; TACTILE_PROFILE names another"
    if last and last != name:
        return f"profile {name}; what is here was made with {last}, and is stale until made anew"
    return f"profile {name}"


AnyConfig = TypeVar("AnyConfig", bound=dg.Config)


class RunRefused(dg.DagsterError, click.ClickException):
    """What is wrong with the config of a run that has not begun.

    Dagster hands on an error of its own as it is, and the command line prints one of click's in
    one line.
    """


class StageConfig(dg.Config):
    """Run config that says in one line what is wrong with it.

    Names are plain text in it, whatever they are chosen from. Mixed with the settings of a stage it
    has their fields, and may be passed wherever the core takes those settings.
    """

    model_config = ConfigDict(use_enum_values=True)

    def __init__(self, **values: Any) -> None:
        try:
            super().__init__(**values)
        except ValidationError as error:
            raise TactileError(problems(error)) from error


def defaults(
    settings: Settings, **names: Iterable[str]
) -> Callable[[type[AnyConfig]], type[AnyConfig]]:
    """Class decorator: the fields of a config class take their defaults from `settings`.

    Their bounds join the descriptions: Dagster's own schema, which the UI shows, has no place for
    them. A value that breaks one is refused as soon as a run is asked for, before its first step.

    names : field → the names that may stand in its list; the UI offers them
    """

    def with_defaults(config: type[AnyConfig]) -> type[AnyConfig]:
        fields: dict[str, Any] = {}
        for name, field in type(settings).model_fields.items():
            own = copy.copy(field)
            own.default = getattr(settings, name)
            own.description = " ".join(filter(None, [field.description, bounds(field)]))
            fields[name] = (field.annotation, own)
            if name in names:
                fields[name] = (listed(name, names[name], field), own)
        model = create_model(
            config.__name__,
            __base__=config,
            __doc__=config.__doc__,
            __module__=config.__module__,
            **fields,
        )
        when_a_run_is_asked_for(model, refuse_what_is_wrong(model))
        return model

    return with_defaults


def listed(name: str, names: Iterable[str], field: FieldInfo) -> Any:
    """The type of a list of these names, as Dagster understands choices; it may be left out where
    the field may."""
    choices: Any = StrEnum(name, {one: one for one in names})  # type: ignore[misc]
    some: Any = list[choices]
    return some | None if type(None) in get_args(field.annotation) else some


def refuse_what_is_wrong(config: type[AnyConfig]) -> Callable[[Mapping[str, Any]], None]:
    def refuse(values: Mapping[str, Any]) -> None:
        try:
            config(**values)
        except TactileError as error:
            raise RunRefused(str(error)) from None

    return refuse


BOUNDS = {
    "ge": "at least {}",
    "gt": "more than {}",
    "le": "at most {}",
    "lt": "less than {}",
    "multiple_of": "a multiple of {}",
    "min_length": "{} or more entries",
    "max_length": "{} or fewer entries",
}


def bounds(field: FieldInfo) -> str:
    """The bounds of a setting, and of what it lists, in brackets: (at least 48, at most 512)."""
    said = worded(field)
    # The bounds of an annotated type, in a list or beside None, are a field's of their own.
    each = "each " if get_origin(field.annotation) in (list, dict) else ""
    for kind in get_args(field.annotation):
        for part in get_args(kind):
            if isinstance(part, FieldInfo):
                said += [f"{each}{bound}" for bound in worded(part)]
    return f"({', '.join(said)})" if said else ""


def worded(field: FieldInfo) -> list[str]:
    return [
        text.format(getattr(given, name))
        for given in field.metadata
        for name, text in BOUNDS.items()
        if getattr(given, name, None) is not None
    ]
