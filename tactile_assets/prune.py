"""What is old and not needed any more: found, listed and removed.

Kept is whatever a stored asset is read from, the runs that made it or last checked it, and what
is younger than some days. Downloads stay.
"""

import contextlib
import time
from collections.abc import Callable, Iterator, Set
from pathlib import Path
from typing import Any, NamedTuple

import dagster as dg
from upath import UPath

from tactile_assets.config import StageConfig, defaults
from tactile_assets.dagster_internals import checking_runs, run_files
from tactile_assets.provenance import own_instance
from tactile_assets.resources import STEPS, Store
from tactile_assets.runs import FINISHED, is_over
from tactile_core.addresses import one_line
from tactile_core.claims import claimed
from tactile_core.errors import TactileError
from tactile_core.files import in_reach
from tactile_core.processes import Worker
from tactile_core.settings import PruneSettings

DAY = 24 * 3600


class Old(NamedTuple):
    """Something that may go: of what kind, its name, its bytes, and what removes it."""

    kind: str
    name: str
    size: int
    remove: Callable[[], None]


def find_old(instance: dg.DagsterInstance, store: Store, settings: PruneSettings) -> list[Old]:
    """Everything that may go, by kind and name. No run may be at work in the home or the store."""
    before = time.time() - settings.days * DAY
    found = [
        *old_runs(instance, store, before, settings.runs),
        *old_figures(instance, store, before),
        *old_policies(store, before),
        *old_work(store, before),
        *(
            left("steps", store.path(STEPS, run))
            for run in store.stored_steps()
            if is_over(instance, run)
        ),
    ]
    return sorted(found, key=lambda old: (old.kind, old.name))


def old_runs(instance: dg.DagsterInstance, store: Store, before: float, keep: int) -> Iterator[Old]:
    """Runs that ended `before`, but for the last `keep`, and for those that made or last checked
    what is stored. Their events and logs go with them."""
    needed = needed_runs(instance)
    for record in instance.get_run_records(dg.RunsFilter(statuses=FINISHED))[keep:]:
        run_id = record.dagster_run.run_id
        if run_id not in needed and (record.end_time or 0) < before:
            files = run_files(Path(store.home), run_id)

            def remove(run_id: str = run_id, files: list[Path] = files) -> None:
                instance.delete_run(run_id)
                instance.compute_log_manager.delete_logs(prefix=[run_id])
                for file in files:
                    file.unlink(missing_ok=True)

            yield Old("run", run_id, sum(file.stat().st_size for file in files), remove)


def needed_runs(instance: dg.DagsterInstance) -> set[str]:
    """The runs of every asset's last materialisation, and of every check's last execution."""
    from tactile_assets.definitions import defs

    checks = defs.get_repository_def().asset_graph.asset_check_keys
    return {event.run_id for event in last_events(instance)} | checking_runs(instance, checks)


def last_events(instance: dg.DagsterInstance) -> list[dg.EventLogEntry]:
    found = map(instance.get_latest_materialization_event, instance.all_asset_keys())
    return [event for event in found if event is not None]


def old_figures(instance: dg.DagsterInstance, store: Store, before: float) -> Iterator[Old]:
    """Figures of `before` that no asset shows; none where an asset is stored that the records do
    not know. Another home made that, or this one before its records were lost, and its figures."""
    if unknown(instance, store):
        return
    shown = " ".join(str(event.asset_materialization) for event in last_events(instance))
    for figure in children(store.path("figures")):
        if figure.name not in shown and newest(figure) < before:
            yield left("figure", figure)


def unknown(instance: dg.DagsterInstance, store: Store) -> bool:
    """Whether the store holds an asset that was never materialised in this home."""
    held = [file.stem for file in children(store.path()) if file.suffix == ".parquet"]
    held += [folder for folder in ("unet", "policies") if store.path(folder).exists()]
    return any(
        instance.get_latest_materialization_event(dg.AssetKey(asset)) is None for asset in held
    )


def old_policies(store: Store, before: float) -> Iterator[Old]:
    """Policies of `before` that do not belong to the asset any more."""
    from tactile_core.exploration.policies.index import INDEX, read_versions  # torch takes seconds

    folder = store.path("policies")
    stored = children(folder)
    named: Set[str] = read_versions(folder).keys() if folder / INDEX in stored else set()
    for policy in stored:
        if policy.is_dir() and policy.name not in named and newest(policy) < before:
            yield left("policy", policy)


def old_work(store: Store, before: float) -> Iterator[Old]:
    """Checkpoints, trials and curves for TensorBoard that nothing was added to since `before`."""
    from tactile_core.dataset.meshes import DOWNLOADS

    for work in [*children(UPath(store.work())), *children(store.path("cache"))]:
        if work.is_dir() and work.name != DOWNLOADS:
            places = children(work) if work.name == "policies" else [work]
            yield from (left("work", place) for place in places if newest(place) < before)


def left(kind: str, place: UPath) -> Old:
    """A file or folder that may go."""

    def remove() -> None:
        with in_reach(place, "removed"):
            place.fs.rm(place.path, recursive=True)

    return Old(kind, place.name, sum(stat.st_size for stat in stats_of(place)), remove)


def newest(place: UPath) -> float:
    """When the last of a folder's files was written, or a file; in Unix time."""
    return max((stat.st_mtime for stat in stats_of(place)), default=0.0)


def stats_of(place: UPath) -> list[Any]:
    """Size and time of a folder's files, or of a file."""
    with in_reach(place, "listed"):
        files = [file for file in place.rglob("*") if file.is_file()] if place.is_dir() else [place]
        return [file.stat() for file in files]


def children(folder: UPath) -> list[UPath]:
    with in_reach(folder, "listed"):
        return sorted(folder.iterdir(), key=lambda path: path.name) if folder.is_dir() else []


def report(found: list[Old], settings: PruneSettings) -> Iterator[str]:
    """A line for each thing that goes, or may, and one for all."""
    for old in found:
        yield f"{old.kind:8} {old.name:40} {old.size / 1e6:10.2f} MB"
    done = "would be removed" if settings.dry_run else "removed"
    yield f"{len(found)} things {done}, {sum(old.size for old in found) / 1e6:.2f} MB"


def prune(
    instance: dg.DagsterInstance, store: Store, settings: PruneSettings, say: Callable[[str], Any]
) -> None:
    """Remove what is old, or with `dry_run` only say what that would be.

    Raises `TactileError` where something stays that may not be removed, when all else is.
    """
    found, stays = find_old(instance, store, settings), {}
    for old in [] if settings.dry_run else found:
        try:
            old.remove()
        except (OSError, TactileError) as error:
            stays[old] = one_line(error)
    for line in report([old for old in found if old not in stays], settings):
        say(line)
    if stays:
        old, why = next(iter(stays.items()))
        raise TactileError(
            f"{len(stays)} things could not be removed, as the {old.kind} {old.name} ({why}): "
            "remove them as the user that they belong to"
        )


def main(settings: PruneSettings) -> None:
    """As `prune`, in the home, when no run is at work there any more."""
    store = Store.from_environment()
    with own_instance() as instance, contextlib.ExitStack() as claims:
        for folder in store.claimed_folders():
            claims.enter_context(claimed(folder, f"tactile prune ({Worker.here()})", print))
        prune(instance, store, settings, print)


@defaults(PruneSettings())
class PruneConfig(StageConfig, PruneSettings):
    """What is old enough to go."""


@dg.op
def remove_old(context: dg.OpExecutionContext, config: PruneConfig, store: Store) -> None:
    """Remove what is old and not needed any more."""
    prune(context.instance, store, config, context.log.info)


@dg.job(name="prune", description="Removes what is old and that no stored asset needs.")
def prune_job() -> None:
    remove_old()
