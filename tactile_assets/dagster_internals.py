"""What Dagster offers under no public name (1.13.27), in one place.

`tests/assets/test_dagster_internals.py` says what breaks should it change.
"""

import contextlib
import itertools
import time
from collections.abc import Callable, Iterable, Mapping
from datetime import timedelta
from pathlib import Path
from typing import Any

import dagster as dg
from dagster._core.definitions.data_version import CachingStaleStatusResolver, StaleStatus
from dagster._core.definitions.definitions_class import SINGLETON_REPOSITORY_NAME
from dagster._core.errors import DagsterExecutionInterruptedError
from dagster._core.execution import context_creation_job
from dagster._core.loader import LoadingContextForTest
from dagster._core.remote_origin import (
    ManagedGrpcPythonEnvCodeLocationOrigin,
    RemoteRepositoryOrigin,
)
from dagster._core.storage.tags import REPOSITORY_LABEL_TAG
from dagster._core.types.loadable_target_origin import LoadableTargetOrigin
from dagster._utils.interrupts import raise_interrupts_as
from dagster._utils.schedules import cron_string_iterator, is_valid_cron_string


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


def verdicts(
    instance: dg.DagsterInstance, checks: Iterable[dg.AssetCheckKey]
) -> dict[dg.AssetCheckKey, bool | None]:
    """Whether each of `checks` passed, if only with a warning, when it was last executed; None
    where that was not since the last materialisation of its asset."""
    found: dict[dg.AssetCheckKey, bool | None] = dict.fromkeys(checks)
    storage = instance.event_log_storage
    for key, record in storage.get_latest_asset_check_execution_by_key(list(found)).items():
        made = instance.get_latest_materialization_event(key.asset_key)
        verdict = record.evaluation
        if isinstance(verdict, dg.AssetCheckEvaluation) and made is not None:  # else it is planned
            of = verdict.target_materialization_data
            if of is not None and of.run_id == made.run_id:
                found[key] = verdict.passed or verdict.severity == dg.AssetCheckSeverity.WARN
    return found


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


def when_a_run_is_asked_for(
    config: type[dg.Config], look: Callable[[Mapping[str, Any]], None]
) -> None:
    """Have `look` see the values of this run config, with defaults, before there is a run.

    Dagster builds the config class itself, with its bounds, only within the step. Before, it knows
    the schema of the class, of which there is one object for every op that has it.
    """
    schema = config.to_config_schema().as_field().config_type

    def process(values: Mapping[str, Any]) -> Mapping[str, Any]:
        look(values)
        return values

    schema.post_process = process  # type: ignore[method-assign]


def count_as_run_of(location: str, module: str, instance: dg.DagsterInstance, run_id: str) -> None:
    """Have the UI show a run of the command line as it shows its own, under Jobs and in the
    timeline: as one of the code location that loads this module."""
    run = instance.get_run_by_id(run_id)
    if run is None or run.remote_job_origin is not None:
        return
    target = LoadableTargetOrigin(module_name=module)
    origin = RemoteRepositoryOrigin(
        ManagedGrpcPythonEnvCodeLocationOrigin(target, location), SINGLETON_REPOSITORY_NAME
    )
    instance.add_run_tags(run_id, {REPOSITORY_LABEL_TAG: origin.get_label()})
    tagged = run.with_tags({**run.tags, REPOSITORY_LABEL_TAG: origin.get_label()})
    instance.run_storage.replace_job_origin(tagged, origin.get_job_origin(run.job_name))


def is_schedule(cron: str) -> bool:
    """Whether Dagster takes this for a schedule of five fields that has a tick at all."""
    if len(cron.split()) != 5 or not is_valid_cron_string(cron):
        return False
    try:
        next(cron_string_iterator(time.time(), cron, "UTC"))
    except ValueError:  # as on the 31st of April
        return False
    return True


def longest_wait(cron: str) -> timedelta:
    """The longest time between two of the next hundred ticks of a schedule."""
    ticks = itertools.islice(cron_string_iterator(time.time(), cron, "UTC"), 100)
    return max(after - before for before, after in itertools.pairwise(ticks))
