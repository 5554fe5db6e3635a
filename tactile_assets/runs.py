"""Runs: one at a time in a home and in a store, and those whose process is gone are told so.

A run that is killed cannot say that it failed. Dagster would take it for one in progress, and start
no other.
"""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import dagster as dg
from dagster import DagsterRunStatus

from tactile_assets.config import PROFILE
from tactile_assets.dagster_internals import count_as_run_of, interruptible
from tactile_assets.resources import Store
from tactile_core.claims import claimed
from tactile_core.files import remove_parts, written_whole
from tactile_core.home import LAST_PROFILE
from tactile_core.processes import Worker
from tactile_core.ray_folders import remove_dead_rays
from tactile_core.spread import on_cluster

LOCATION, DEFINITIONS = "tactile-exploration", "tactile_assets.definitions"  # see workspace.yaml

# Tags of a run: its process, as `Worker` has it, and its id, as a run that is executed again in the
# UI begins with all tags of the one before.
HOST, PID, SINCE, MARK = "tactile/host", "tactile/pid", "tactile/since", "tactile/process"
OF = "tactile/run"
FINISHED = [DagsterRunStatus.SUCCESS, DagsterRunStatus.FAILURE, DagsterRunStatus.CANCELED]
UNFINISHED = [DagsterRunStatus.STARTING, DagsterRunStatus.STARTED, DagsterRunStatus.CANCELING]


class OneAtATime(dg.Executor):
    """Lets another executor work while no other run does in the same home or store."""

    def __init__(self, executor: dg.Executor, store: Store) -> None:
        self.executor = executor
        self.store = store

    @property
    def retries(self) -> Any:
        return self.executor.retries

    @property
    def step_dependency_config(self) -> Any:
        return self.executor.step_dependency_config

    def execute(self, plan_context: Any, execution_plan: Any) -> Iterator[dg.DagsterEvent]:
        instance, run, log = plan_context.instance, plan_context.dagster_run, plan_context.log
        worker = Worker.here()
        # Before anything is waited for: of a run that is killed without them nobody knows that.
        instance.add_run_tags(run.run_id, tags_of(worker, run.run_id))
        count_as_run_of(LOCATION, DEFINITIONS, instance, run.run_id)
        made = {key.partition(".")[0] for key in execution_plan.step_keys_to_execute}
        if run.parent_run_id is None and (idle := run.run_config.get("ops", {}).keys() - made):
            log.warning(
                f"The configuration of {', '.join(sorted(idle))} has no effect: this run makes "
                "only what was selected"
            )
        if on_cluster():
            from tactile_core.cluster import joined

            with joined():  # what does not fit is told before anything is made
                pass
        with contextlib.ExitStack() as claims:
            with interruptible():
                for folder in self.store.claimed_folders():
                    name = f"run {run.run_id} ({worker})"
                    claims.enter_context(claimed(folder, name, log.info))
            # Commands that name no profile have this one, too.
            with written_whole(Path(self.store.home, LAST_PROFILE)) as file:
                file.write(PROFILE.name.encode())
            for sentence in [*end_dead_runs(instance), *clear_up(self.store, instance, run)]:
                log.info(sentence)
            yield from self.executor.execute(plan_context, execution_plan)


def one_at_a_time(executor: dg.ExecutorDefinition, store: Store) -> dg.ExecutorDefinition:
    """`executor`, as `OneAtATime` lets it work."""
    create, schema = executor.executor_creation_fn, cast(Any, executor.config_schema)
    assert create is not None
    return dg.ExecutorDefinition(
        name=executor.name,
        config_schema=schema,
        requirements=executor.get_requirements,
        executor_creation_fn=lambda context: OneAtATime(create(context), store),
        description=executor.description,
    )


def tags_of(worker: Worker, run_id: str) -> dict[str, str]:
    """The process of a run as the run's tags."""
    host, pid, started, mark = worker
    return {HOST: host, PID: str(pid), SINCE: repr(started), MARK: mark, OF: run_id}


def worker_of(run: dg.DagsterRun) -> Worker | None:
    """The process that said in the run's tags that it works on it; None before it did."""
    tags = run.tags
    if not {HOST, PID, SINCE} <= tags.keys() or tags.get(OF) != run.run_id:
        return None
    return Worker(tags[HOST], int(tags[PID]), float(tags[SINCE]), tags.get(MARK, ""))


def end_dead_runs(instance: dg.DagsterInstance) -> list[str]:
    """Mark every run as failed, or canceled, whose process on this machine is gone; one sentence
    about each."""
    sentences = []
    for run in instance.get_runs(dg.RunsFilter(statuses=UNFINISHED)):
        worker = worker_of(run)
        if worker is None or not worker.is_gone() or is_over(instance, run.run_id):
            continue
        sentence = f"{worker}, is gone without a word; a new run goes on with what it left"
        if run.status == DagsterRunStatus.CANCELING:
            instance.report_run_canceled(run, sentence)
        else:
            instance.report_run_failed(run, sentence)
        instance.event_log_storage.free_concurrency_slots_for_run(run.run_id)
        sentences.append(f"run {run.run_id} has ended: {sentence}")
    return sentences


def clear_up(store: Store, instance: dg.DagsterInstance, run: dg.DagsterRun) -> list[str]:
    """Remove what killed runs left behind, but for the steps that `run` goes on from; in a
    sentence, if there was anything. The home and the store must be claimed."""
    parts = sum(map(remove_parts, store.local_folders()))
    rays = remove_dead_rays()
    kept = set(line_of(instance, run))
    steps = [left for left in store.stored_steps() - kept if is_over(instance, left)]
    for left in steps:
        store.forget_steps(left)
    found = {"half-written files": parts, "local Rays": rays, "runs' steps": len(steps)}
    words = ", ".join(f"{number} {what}" for what, number in found.items() if number)
    return [f"removed what killed runs left behind: {words}"] if words else []


def line_of(instance: dg.DagsterInstance, run: dg.DagsterRun) -> Iterator[str]:
    """The run and those before it that it goes on from: each may have made some of its steps."""
    before: dg.DagsterRun | None = run
    while before is not None:
        yield before.run_id
        parent = before.parent_run_id
        before = instance.get_run_by_id(parent) if parent else None


def is_over(instance: dg.DagsterInstance, run_id: str) -> bool:
    """Whether a run is known here and finished: another home may work in the same store."""
    run = instance.get_run_by_id(run_id)
    return run is not None and run.is_finished
