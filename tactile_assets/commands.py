"""The commands that `tactile` has for Dagster's side of the house."""

from importlib.util import find_spec

import click

from tactile_assets.paths import REPOSITORY
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
    need_checkout()
    from tactile_assets.publish import main

    main(name, note)


@click.command()
def weights() -> None:
    """Make the last run's weights those that the package ships.

    They go to tactile_core/pretrained, with their provenance, once they were tested.
    """
    need_dagster()
    need_checkout()
    from tactile_assets.publish import run_facts
    from tactile_assets.resources import Store
    from tactile_assets.results import stored_evaluations
    from tactile_core.evaluation.shipping import ship
    from tactile_core.exploration.pretrained import FOLDER

    store = Store.from_environment()
    made = run_facts(store, stored_evaluations(store))
    ship(store.path(), FOLDER, made, click.echo)
    click.echo(f"Shipped from {FOLDER}")


@click.command()
@click.option(
    "--days", type=click.FloatRange(0), default=30, show_default=True, help="Keep what is younger."
)
@click.option(
    "--runs",
    type=click.IntRange(0),
    default=20,
    show_default=True,
    help="Keep so many of the last runs, however old.",
)
@click.option("--dry-run", is_flag=True, help="Only list what would go, with sizes.")
def prune(days: float, runs: int, dry_run: bool) -> None:
    """Remove what earlier runs left and nothing stored needs.

    Records of runs, checkpoints, trials, curves for TensorBoard, policies that are not trained any
    more, figures that no asset shows, and what steps handed each other.
    """
    need_dagster()
    from tactile_assets.prune import main
    from tactile_core.settings import PruneSettings

    main(PruneSettings(days=days, runs=runs, dry_run=dry_run))


def need_dagster() -> None:
    """Raises `TactileError` where the platform is not installed."""
    if find_spec("dagster") is None:
        raise TactileError(
            "this command needs Dagster: pip install 'tactile-exploration[platform]'"
        )


def need_checkout() -> None:
    """Raises `TactileError` where nothing but an installed package is there to be written to."""
    if not (REPOSITORY / "pyproject.toml").is_file():
        raise TactileError("this command writes into a checkout of the repository: run it in one")
