"""Runs that are killed at random moments: `make chaos`, or `python -m tests.chaos --kills 50`.

In the tiny chain of the tests a run is killed (kill -9) and begun again, some times over, and then
runs to its end. It must end in the data versions of a run that nobody disturbed, and leave nothing
behind. Prints a line for each kill, as a table in Markdown.
"""

import os

os.environ["TACTILE_PROFILE"] = "smoke"

import argparse
import json
import random
import shlex
import subprocess
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import dagster as dg
import psutil

from tactile_assets.runs import UNFINISHED
from tactile_core.claims import LOCK
from tactile_core.files import PART
from tactile_core.processes import those_with
from tests.assets.running import ALL, Platform, begin, run_for

KILLS_A_HOME = 4
SECONDS_TO_END = 20  # one that was killed lets go of its memory first, on a busy machine slowly


class Kill(NamedTuple):
    """A run that was killed: after how many seconds, and what it was at, as its console says."""

    seconds: float
    at: str


def begin_chain(home: Path, assets: Sequence[str]) -> subprocess.Popen:
    """Begin a run of these assets of the tiny chain."""
    home.mkdir(parents=True, exist_ok=True)
    config = home / "tiny.json"
    config.write_text(json.dumps(run_for(tuple(assets))))
    return begin(f"dagster asset materialize --select {','.join(assets)} -c {config}", home)


def run_to_its_end(home: Path, assets: Sequence[str]) -> float:
    """How many seconds it took."""
    start = time.monotonic()
    with begin_chain(home, assets) as run:
        said = run.communicate()[1]
    if run.returncode:
        raise SystemExit(f"a run of {home} failed:\n{said}")
    return time.monotonic() - start


def kill_after(seconds: float, home: Path, assets: Sequence[str]) -> Kill:
    """Begin a run and kill it; nothing but its main process is told."""
    with begin_chain(home, assets) as run:
        try:
            said = run.communicate(timeout=seconds)[1]
        except subprocess.TimeoutExpired:
            run.kill()
            said = run.communicate()[1]
    lines = [line.split() for line in said.splitlines() if line.strip()]
    return Kill(seconds, "its end" if run.returncode == 0 else lines[-1][1] if lines else "loading")


def data_versions(home: Path, assets: Sequence[str]) -> dict[str, str]:
    with dg.DagsterInstance.from_config(str(home / "dagster")) as instance:
        return Platform(home, instance).data_versions(list(assets))


def left_behind(home: Path) -> list[str]:
    """What should not be there once a run is over: processes, half-written files, steps, locks,
    and runs that seem to be under way."""
    last = time.monotonic() + SECONDS_TO_END
    while (left := those_with("TACTILE_HOME", str(home))) and time.monotonic() < last:
        time.sleep(0.1)
    found = [said_of(process) for process in left]
    found += [str(file) for file in home.rglob(".*.part") if PART.fullmatch(file.name)]
    found += [str(place) for place in (home / "artifacts" / "steps").glob("*")]
    found += [str(lock) for lock in home.rglob(LOCK) if lock.read_text()]
    with dg.DagsterInstance.from_config(str(home / "dagster")) as instance:
        found += [
            f"run {run.run_id}" for run in instance.get_runs(dg.RunsFilter(statuses=UNFINISHED))
        ]
    return found


def said_of(process: psutil.Process) -> str:
    """Its number, its state and its command."""
    try:
        return f"process {process.pid}, {process.status()}: {shlex.join(process.cmdline())}"
    except psutil.Error:
        return f"process {process.pid}, gone since"


def main() -> None:
    parser = argparse.ArgumentParser("python -m tests.chaos", description=__doc__)
    parser.add_argument("--kills", type=int, default=12)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    draw = random.Random(given.seed)
    print("| kill | after seconds | at | the end has the same data versions | left behind |")
    print("|---|---|---|---|---|", flush=True)
    with tempfile.TemporaryDirectory(prefix="chaos-") as folder:
        undisturbed = Path(folder, "undisturbed")
        seconds = run_to_its_end(undisturbed, ALL)
        versions = data_versions(undisturbed, ALL)
        failures = 0
        for first in range(0, given.kills, KILLS_A_HOME):
            home = Path(folder, f"killed-{first}")
            kills = [
                kill_after(draw.uniform(0, seconds), home, ALL)
                for _ in range(min(KILLS_A_HOME, given.kills - first))
            ]
            run_to_its_end(home, ALL)
            same = data_versions(home, ALL) == versions
            left = left_behind(home)
            failures += not same or bool(left)
            for number, kill in enumerate(kills, first + 1):
                verdict = f"{'yes' if same else 'NO'} | {', '.join(left) or 'nothing'}"
                print(f"| {number} | {kill.seconds:.1f} | {kill.at} | {verdict} |", flush=True)
    raise SystemExit(failures)


if __name__ == "__main__":
    main()
