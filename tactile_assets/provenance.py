"""How a result was made: noted with the evaluations while they are made, for `publish` to read."""

import contextlib
import os
import platform
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import dagster as dg
from sqlalchemy.exc import DatabaseError

from tactile_assets.config import PROFILE
from tactile_assets.paths import REPOSITORY
from tactile_core.addresses import one_line, shown
from tactile_core.errors import TactileError
from tactile_core.machine import commit, memory_gib, processor, processors
from tactile_core.settings import EvaluationSettings

VARIABLES = ("TACTILE_PROFILE", "TACTILE_SHAPENET", "TACTILE_REAL")


def made_with(settings: EvaluationSettings) -> dict[str, Any]:
    """What `made_here` says, with the profile and how the evaluation's intervals are drawn."""
    bootstrap = settings.model_dump(include={"resamples", "seed"})
    return {
        "profile": PROFILE.name, "bootstrap": bootstrap, "choice": settings.choice, **made_here()
    }  # fmt: skip


def made_here() -> dict[str, Any]:
    """The commit, the variables that are set, the machine and the Python of this process."""
    from tactile_core.reconstruction.inference import best_device, bfloat16_pays

    device = best_device().type
    precision = "bfloat16" if bfloat16_pays(device) else "float32"
    return {
        "commit": commit(REPOSITORY) or "unknown",
        "variables": {n: shown(os.environ[n]) for n in VARIABLES if os.environ.get(n)},
        "machine": f"{processors()} × {processor()}, {memory_gib():.0f} GiB, "
        f"{platform.system()}, {device} in {precision}",
        "python": platform.python_version(),
    }


def how_made(instance: dg.DagsterInstance, asset: str) -> dict[str, Any]:
    """What `made_with` said when the evaluation `asset` was last materialised."""
    metadata = latest(instance, asset)[1].metadata
    made = metadata["made_with"].value if "made_with" in metadata else None
    if not isinstance(made, dict) or "bootstrap" not in made:
        raise TactileError(f"{asset} does not say how it was made: materialise it again")
    return dict(made)


@contextlib.contextmanager
def own_instance() -> Iterator[dg.DagsterInstance]:
    """The Dagster instance of the home; raises `TactileError` where its records cannot be opened,
    or fail the block."""
    home = os.environ.get("DAGSTER_HOME")
    if not home:
        raise TactileError("DAGSTER_HOME is not set: activate the environment first")
    try:
        with contextlib.ExitStack() as stack:
            try:
                instance = stack.enter_context(dg.DagsterInstance.get())
            except DatabaseError:
                raise
            except Exception as error:  # of dagster.yaml, or of what it names, which has its own
                wrong = getattr(error, "errors", None)  # of a configuration that is not valid
                cause = ValueError(wrong[0].message) if wrong else error.__cause__ or error
                raise TactileError(
                    f"Dagster's records cannot be opened as {home}/dagster.yaml has it "
                    f"({one_line(cause)}): correct it or its variables, or let its server answer"
                ) from error
            yield instance
    except DatabaseError as error:  # of a full disk, a damaged file or a server that is down
        said = one_line(error.orig or error)
        raise TactileError(
            f"Dagster's records in {home} cannot be read or written ({said}): make room, or mend "
            "that"
        ) from error


class Run(NamedTuple):
    """A finished run: its configuration, its start in Unix time, and how long it took."""

    config: Mapping[str, Any]
    start: float
    seconds: float


def whole_run(instance: dg.DagsterInstance, assets: list[str]) -> Run:
    """The run that made all of `assets`; raises `TactileError` where they are of several runs."""
    made_in = {asset: latest(instance, asset)[0] for asset in assets}
    last = made_in[assets[-1]]
    others = [asset for asset, run in made_in.items() if run != last]
    if others:
        raise TactileError(
            f"{', '.join(others)} and {assets[-1]} were made in different runs, which no one "
            "command repeats: make run again"
        )
    record = instance.get_run_record_by_id(last)
    if record is None or not (record.start_time and record.end_time):
        raise TactileError(f"run {last} is not over or not known any more: make run again")
    return Run(
        record.dagster_run.run_config, record.start_time, record.end_time - record.start_time
    )


def latest(instance: dg.DagsterInstance, asset: str) -> tuple[str, dg.AssetMaterialization]:
    """The run of an asset's last materialisation, and what it said."""
    event = instance.get_latest_materialization_event(dg.AssetKey(asset))
    if event is None or event.asset_materialization is None:
        raise TactileError(f"{asset} has never been materialised here: make run first")
    return event.run_id, event.asset_materialization
