"""Publish a run: `python -m tactile_assets.publish NAME` after `make run`.

Copies the tables and figures of the stored assets to docs/results/NAME, with the command,
commit, machine and time that made them. `python -m tactile_assets.publish` alone only writes anew
the page of every published run, and the README's results from docs/results/study, or
docs/results/laptop where that is not there; a test holds both to it.
"""

import argparse
import json
import os
import platform
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import dagster as dg
import pandas as pd

from tactile_assets.config import PROFILE
from tactile_assets.pages import PICTURES, page, readme_part
from tactile_assets.resources import REPOSITORY, Store
from tactile_assets.results import results_of, stored_evaluations
from tactile_core.errors import TactileError
from tactile_core.evaluation.tables import hyperparameter_rows, reconstruction_rows
from tactile_core.files import read_table

RESULTS = REPOSITORY / "docs" / "results"
README = REPOSITORY / "README.md"
BEGIN, END = "<!-- results: python -m tactile_assets.publish -->", "<!-- end of results -->"


def publish(name: str, note: str | None = None) -> None:
    """Write docs/results/`name` from what the assets stored, with a `note` on how it was run."""
    from tactile_core.reconstruction.trained import load_unet

    store = Store.from_environment()
    reconstruction = read_table(store.path("reconstruction_evaluation.parquet"))
    evaluations = stored_evaluations(store)
    settings = load_unet(store.path("unet")).settings
    folder = RESULTS / name
    folder.mkdir(parents=True, exist_ok=True)
    tables = {
        "hyperparameters": hyperparameter_rows(settings),
        "reconstruction": reconstruction_rows(reconstruction),
    }
    for title, table in evaluations.items():
        results = results_of(table)
        tables |= {
            title: results.rows,
            f"{title}_comparison": results.comparison,
            f"{title}_curve": results.curve,
            f"{title}_summary": results.summary,
        }
    about = run_facts(evaluations)  # before anything is written: the commit must not look changed
    if note:
        about["note"] = note
    for file in folder.glob("real_*.csv"):  # of an earlier run, that this one may not have
        file.unlink()
    for title, table in tables.items():
        table.to_csv(folder / f"{title}.csv", index=False, float_format="%.4f")
    for figure in PICTURES:
        (folder / figure).write_bytes(store.path("figures", figure).read_bytes())
    (folder / "run.json").write_text(json.dumps(about, indent=2, ensure_ascii=False) + "\n")
    print(f"Published to {folder}")


def run_facts(evaluations: dict[str, pd.DataFrame]) -> dict[str, Any]:
    """What, where and when: everything needed to make the same run again."""
    variables = [f"{name}={os.environ[name]} " for name in SETTINGS if os.environ.get(name)]
    per_step = evaluations["per_step"]
    run_config, length = last_run()
    facts = {
        "command": "".join(variables) + command(run_config),
        "commit": commit(),
        "profile": PROFILE.name,
        "test samples": int(per_step["sample_id"].nunique()),
        "seeds": sorted(int(seed) for seed in per_step["seed"].unique()),
        "machine": f"{os.cpu_count()} × {processor()}, {memory_gib()} GiB, {platform.system()}",
        "python": platform.python_version(),
        **length,
    }
    if "real_per_step" in evaluations:
        facts["real samples"] = int(evaluations["real_per_step"]["sample_id"].nunique())
    return facts


SETTINGS = ("TACTILE_PROFILE", "TACTILE_SHAPENET", "TACTILE_REAL")


def command(run_config: Mapping[str, Any]) -> str:
    """What starts a run of every asset with this run configuration."""
    if not run_config:
        return "make run"
    return f"dagster asset materialize --select '*' --config-json '{json.dumps(run_config)}'"


def commit() -> str:
    """The commit of the checkout, marked where files differ from it."""
    described = ["git", "-C", str(REPOSITORY), "describe", "--always", "--abbrev=12", "--dirty"]
    return subprocess.run(described, capture_output=True, text=True).stdout.strip() or "unknown"


def processor() -> str:
    """The processor as Linux names it, with the vector units that matter here."""
    try:
        facts = Path("/proc/cpuinfo").read_text()
    except OSError:
        return platform.processor()
    model = next(line.partition(": ")[2] for line in facts.splitlines() if "model name" in line)
    return model + (" (bfloat16)" if "avx512_bf16" in facts or "amx_bf16" in facts else "")


def memory_gib() -> int:
    return round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30)


def last_run() -> tuple[Mapping[str, Any], dict[str, Any]]:
    """Run configuration of the last successful run of every asset; and its start (UTC) and length
    in minutes."""
    finished = dg.RunsFilter(statuses=[dg.DagsterRunStatus.SUCCESS])
    with dg.DagsterInstance.get() as instance:
        for record in instance.get_run_records(finished, limit=50):
            keys = record.dagster_run.asset_selection
            if (keys is None or len(keys) >= 11) and record.start_time and record.end_time:
                started = pd.Timestamp(record.start_time, unit="s")
                minutes = (record.end_time - record.start_time) / 60
                length = {"started": f"{started:%Y-%m-%d %H:%M} UTC", "minutes": round(minutes, 1)}
                return record.dagster_run.run_config, length
    raise TactileError("no run of all assets has succeeded: make run first")


def shown_run(results: Path = RESULTS) -> Path:
    """The published run whose results the README shows: the long one, where there is one."""
    study = results / "study"
    return study if study.is_dir() else results / "laptop"


def with_results(readme: str, results: str) -> str:
    """The README with the section between the two marks replaced."""
    before, _, rest = readme.partition(BEGIN)
    _, mark, after = rest.partition(END)
    if not mark:
        raise TactileError(f"{README} lacks the marks {BEGIN!r} and {END!r}")
    return f"{before}{BEGIN}\n\n{results}\n\n{END}{after}"


def main(arguments: list[str]) -> None:
    parser = argparse.ArgumentParser("python -m tactile_assets.publish", description=__doc__)
    parser.add_argument("name", nargs="?", help="folder below docs/results for the last run")
    parser.add_argument("--note", help="what else to know of this run, in a sentence")
    given = parser.parse_args(arguments)
    if given.name:
        publish(given.name, given.note)
    for run in RESULTS.glob("*/run.json"):
        (run.parent / "README.md").write_text(page(run.parent))
    README.write_text(with_results(README.read_text(), readme_part(shown_run())))


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except TactileError as error:
        sys.exit(str(error))
