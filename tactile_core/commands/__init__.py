"""The command line, `tactile`: one command for each module of this folder, named like it.

Other packages add theirs through the entry points `tactile.commands` (pyproject.toml). A module is
loaded when its command is called or `--help` lists it: it imports what is heavy in its function.
"""

import importlib
import pkgutil
from importlib.metadata import EntryPoint, entry_points
from typing import Any

import click

from tactile_core.errors import TactileError

GROUP = "tactile.commands"


class Commands(click.Group):
    """Commands that are found by their names. A `TactileError` ends any of them as one line."""

    def list_commands(self, context: click.Context) -> list[str]:
        return sorted({*own_commands(), *further_commands()})

    def get_command(self, context: click.Context, name: str) -> click.Command | None:
        if name in own_commands():
            found = getattr(importlib.import_module(f"{__name__}.{name}"), name)
        elif name in further_commands():
            found = further_commands()[name].load()
        else:
            return None
        assert isinstance(found, click.Command)
        return found

    def invoke(self, context: click.Context) -> Any:
        try:
            return super().invoke(context)
        except TactileError as error:
            raise click.ClickException(str(error)) from error


def own_commands() -> list[str]:
    """The modules of this folder."""
    return [module.name for module in pkgutil.iter_modules(__path__)]


def further_commands() -> dict[str, EntryPoint]:
    """What other packages add, by name."""
    return {found.name: found for found in entry_points(group=GROUP)}


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="tactile-exploration", message="%(version)s")
def main() -> None:
    """Tactile exploration of objects: feel out a shape, and look at what a run has made."""
