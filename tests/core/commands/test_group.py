"""The command `tactile`: which commands there are, and how it says what went wrong."""

import subprocess
import sys

import click
import pytest
from click.testing import CliRunner

from tactile_core import commands
from tactile_core.commands import main
from tactile_core.errors import DamagedError


def test_each_command_has_the_name_of_its_module_and_a_line_of_help():
    context = click.Context(main)
    for name in main.list_commands(context):
        command = main.get_command(context, name)
        assert command is not None and command.name == name
        assert command.get_short_help_str(), name


def test_help_lists_every_command_and_loads_nothing_heavy():
    heavy = ["torch", "dagster", "ray", "numba", "matplotlib", "pandas"]
    code = (
        "import sys; from tactile_core.commands import main;"
        "main(['--help'], standalone_mode=False);"
        f"print([name for name in {heavy} if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"
    for name in main.list_commands(click.Context(main)):
        assert f"\n  {name} " in done.stdout


def test_an_error_of_ours_is_one_line_and_any_other_one_is_not_hidden(monkeypatch):
    errors = {"ours": DamagedError("x.parquet is damaged: mend it"), "other": RuntimeError("bug")}

    def get(self, context, name):
        @click.command()
        def failing():
            raise errors[name]

        return failing

    monkeypatch.setattr(commands.Commands, "get_command", get)
    done = CliRunner().invoke(main, ["ours"])
    assert (done.exit_code, done.stderr) == (1, "Error: x.parquet is damaged: mend it\n")
    with pytest.raises(RuntimeError, match="bug"):
        CliRunner().invoke(main, ["other"], catch_exceptions=False)


def test_a_command_that_there_is_not_is_refused_by_name():
    done = CliRunner().invoke(main, ["fell", "mug"])
    assert done.exit_code == 2 and "No such command 'fell'" in done.stderr
