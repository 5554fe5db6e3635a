"""The commands that `tactile` has for Dagster's side of the house."""

from importlib.util import find_spec

import click

from tactile_core.errors import TactileError


@click.command()
def results() -> None:
    """Print the tables of the last run."""
    need_dagster()
    from tactile_assets.results import main

    main()


@click.command()
@click.argument("name", required=False)
@click.option("--note", help="What else to know of this run, in a sentence.")
def publish(name: str | None, note: str | None) -> None:
    """Copy the last run to docs/results/NAME, with a page of its own.

    Without NAME, only the pages of what is published and the README's results are written anew.
    """
    need_dagster()
    from tactile_assets.publish import main

    main(name, note)


def need_dagster() -> None:
    """Raises `TactileError` where the platform is not installed."""
    if find_spec("dagster") is None:
        raise TactileError(
            "this command needs Dagster: pip install 'tactile-exploration[platform]'"
        )
