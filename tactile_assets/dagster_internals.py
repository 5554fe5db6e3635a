"""What Dagster offers under no public name (1.13.27), in one place.

`tests/assets/test_dagster_internals.py` says what breaks should it change.
"""

import contextlib
from collections.abc import Iterable
from pathlib import Path

import dagster as dg
from dagster._core.definitions.data_version import CachingStaleStatusResolver, StaleStatus
from dagster._core.errors import DagsterExecutionInterruptedError
from dagster._core.execution import context_creation_job
from dagster._core.loader import LoadingContextForTest
from dagster._utils.interrupts import raise_interrupts_as


def make_default_console(console: dg.LoggerDefinition) -> None:
    """Make this the console of every run that names no logger of its own.

    Dagster uses the loggers of `Definitions` only where run config names them, and has no setting
    for which ones stand in otherwise.
    """
    context_creation_job.default_system_loggers = lambda instance: [(console, {})]


def interruptible() -> contextlib.AbstractContextManager[None]:
    """Let an interrupt end the block at once, as it does a step's own code.

    Between the steps Dagster only notes that there was one.
    """
    return raise_interrupts_as(DagsterExecutionInterruptedError)


def checking_runs(instance: dg.DagsterInstance, checks: Iterable[dg.AssetCheckKey]) -> set[str]:
    """The runs that last executed each of `checks`."""
    storage = instance.event_log_storage
    last = storage.get_latest_asset_check_execution_by_key(list(checks))
    return {record.run_id for record in last.values()}


def run_files(home: Path, run_id: str) -> list[Path]:
    """The files that SQLite, where Dagster keeps its records in it, holds of a run alone."""
    return sorted(Path(home, "dagster", "history", "runs").glob(f"{run_id}.db*"))


def stale_assets(
    instance: dg.DagsterInstance, definitions: dg.Definitions, assets: list[str]
) -> set[str]:
    """Those of `assets` that the UI shows as stale or missing."""
    graph = definitions.get_repository_def().asset_graph
    resolver = CachingStaleStatusResolver(instance, graph, LoadingContextForTest(instance))
    return {
        asset for asset in assets
        if resolver.get_status(dg.AssetKey(asset)) != StaleStatus.FRESH
    }  # fmt: skip
