"""Publish a run: `tactile publish NAME` after `make run`.

Copies the tables and figures of the stored assets to docs/results/NAME, with the command,
commit, machine and time that made them. `tactile publish` alone only writes anew
the page and Figures 4 and 5 of every published run, and the README's results from
docs/results/study, or docs/results/laptop where that is not there; a test holds all to it.
"""

import json
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pandas as pd

from tactile_assets.chain import in_order
from tactile_assets.config import PROFILE
from tactile_assets.definitions import defs
from tactile_assets.fresh import other_content
from tactile_assets.pages import PICTURES, page, readme_part
from tactile_assets.paths import REPOSITORY
from tactile_assets.provenance import how_made, latest, made_here, own_instance, whole_run
from tactile_assets.resources import FIGURES, Store
from tactile_assets.results import results_of, stored_evaluations
from tactile_core.errors import TactileError
from tactile_core.evaluation.tables import (
    PolicyResults,
    hyperparameter_rows,
    reconstruction_rows,
)
from tactile_core.files import stored_bytes
from tactile_core.parquet import read_table

RESULTS = REPOSITORY / "docs" / "results"
README = REPOSITORY / "README.md"
CURVES = (("per_step", "step", "figure_4.png"), ("per_grasp", "grasp", "figure_5.png"))
DRAWN_BY = {"figure_4.png": "per_step_evaluation", "figure_5.png": "per_grasp_evaluation"}
RUN = "run.json"  # how a run was made, beside its tables
BEGIN, END = "<!-- results: tactile publish -->", "<!-- end of results -->"


def publish(name: str, note: str | None = None) -> None:
    """Write docs/results/`name` from what the assets stored, with a `note` on how it was run.

    Raises `TactileError` where the name is none, or that of something else than a published run.
    """
    from tactile_core.reconstruction.trained import load_unet

    target = RESULTS / name
    if not name or Path(name).name != name or name.startswith("."):
        raise TactileError(f"{name!r} names no run: give a word, such as laptop")
    if target.exists() and not (target / RUN).exists():
        raise TactileError(f"{target} holds no published run, and would be replaced: name another")
    store = Store.from_environment()
    reconstruction = read_table(store.path("reconstruction_evaluation.parquet"))
    evaluations = stored_evaluations(store)
    settings = load_unet(store.path("unet")).settings
    about = run_facts(store, evaluations)
    results = {}
    tables = {
        "hyperparameters": hyperparameter_rows(settings),
        "reconstruction": reconstruction_rows(reconstruction),
    }
    with own_instance() as instance:
        made = {title: how_made(instance, f"{title}_evaluation") for title in evaluations}
    notes = {}
    for title, table in evaluations.items():
        results[title] = one = results_of(table, made[title])
        if one.note:
            notes[title] = one.note
        tables |= {
            title: one.rows,
            f"{title}_comparison": one.comparison,
            f"{title}_curve": one.curve,
            f"{title}_summary": one.summary,
        }
    choice = made["per_step"].get("choice", PROFILE.per_step.choice)
    tables["findings"] = findings_of(store, reconstruction, results, choice)
    if note:
        about["note"] = note
    if notes:
        about["notes"] = notes
    pictures = {figure: picture(store, figure) for figure in PICTURES}
    with written_anew(target) as folder:
        for title, table in tables.items():
            table.to_csv(folder / f"{title}.csv", index=False, float_format="%.4f")
        for figure, data in pictures.items():
            (folder / figure).write_bytes(data)
        (folder / RUN).write_text(json.dumps(about, indent=2, ensure_ascii=False) + "\n")
    print(f"Published to {target}")


def picture(store: Store, figure: str) -> bytes:
    """A figure of the store; raises `TactileError` where it cannot be read."""
    place = store.path(FIGURES, figure)
    try:
        return stored_bytes(place)
    except OSError as error:
        asset = DRAWN_BY.get(figure, "rollouts")
        raise TactileError(f"{place} cannot be read: materialise {asset} again") from error


@contextmanager
def written_anew(folder: Path) -> Iterator[Path]:
    """An empty folder to write to, which takes the place of `folder` if the block succeeds: nothing
    of an earlier run stays."""
    aside, old = (folder.with_name(f".{folder.name}.{word}") for word in ("new", "old"))
    if old.exists() and not folder.exists():  # it was killed between its two last steps
        old.rename(folder)
    for left in (aside, old):
        shutil.rmtree(left, ignore_errors=True)
    aside.mkdir(parents=True)
    try:
        yield aside
        if folder.exists():
            folder.rename(old)
        aside.rename(folder)
    finally:
        for left in (aside, old):
            shutil.rmtree(left, ignore_errors=True)


def findings_of(
    store: Store, reconstruction: pd.DataFrame, results: dict[str, PolicyResults], choice: str
) -> pd.DataFrame:
    """The report's findings beside those of the stored run, whose rays per step are by `choice`."""
    from tactile_core.dataset.shapes import load_shapes
    from tactile_core.evaluation.findings import findings
    from tactile_core.evaluation.readings import by_choice
    from tactile_core.reconstruction.inference import Reconstructor
    from tactile_core.reconstruction.unets import first_of, load_unets

    splits, outlines, rollouts = (
        read_table(store.path(f"{name}.parquet"))
        for name in ("rotated_splits", "outlines", "rollouts")
    )
    return findings(
        reconstruction,
        results["per_step"],
        results["per_grasp"],
        by_choice(rollouts, PROFILE.per_step.model_copy(update={"choice": choice})),
        load_shapes(splits, outlines, "test"),
        Reconstructor(first_of(load_unets(store.path("unet")))),
    )


def run_facts(store: Store, evaluations: dict[str, pd.DataFrame]) -> dict[str, Any]:
    """What, where and when: everything needed to make the same run again.

    Raises `TactileError` where no single run made what is stored, another home did, evaluations are
    of several commits or machines, or the variables have changed.
    """
    assets = in_order(defs)
    with own_instance() as instance:
        run = whole_run(instance, [name for name in assets if not name.startswith("real_")])
        if reason := other_content(instance, store, assets):
            raise TactileError(f"{reason} Make run again, or publish from the home that made it")
        every = [how_made(instance, f"{name}_evaluation") for name in evaluations]
        cast = latest(instance, "rollouts")[1].metadata
    made = every[-1]
    for fact in ("commit", "machine"):
        if len(found := {one[fact] for one in every}) > 1:
            raise TactileError(
                f"{', '.join(evaluations)} are of more than one {fact} "
                f"({', '.join(sorted(found))}): make run again"
            )
    variables = made.pop("variables")
    made.pop("choice", None)  # which each evaluation has its own of
    if variables != (now := made_here()["variables"]):
        raise TactileError(f"the run was made with {variables}, and now {now} is set: set the same")
    per_step = evaluations["per_step"]
    facts = {
        "command": " ".join([*map("=".join, variables.items()), command(run.config)]),
        **made,
        "test samples": int(per_step["sample_id"].nunique()),
        "seeds": sorted(int(seed) for seed in per_step["seed"].unique()),
        "started": f"{pd.Timestamp(run.start, unit='s'):%Y-%m-%d %H:%M} UTC",
        "minutes": round(run.seconds / 60, 1),
    }
    if "unet_runs_through" in cast:  # not in those of before eight bits
        facts["rays cast"] = cast["unet_runs_through"].value
    if "real_per_step" in evaluations:
        facts["real samples"] = int(evaluations["real_per_step"]["sample_id"].nunique())
    return facts


def command(run_config: Mapping[str, Any]) -> str:
    """What starts a run of every asset with this run configuration."""
    if not run_config:
        return "make run"
    return f"dagster asset materialize --select '*' --config-json '{json.dumps(run_config)}'"


def shown_run(results: Path = RESULTS) -> Path:
    """The published run whose results the README shows: the long one, where there is one."""
    study = results / "study"
    return study if study.is_dir() else results / "laptop"


def draw_curves(folder: Path) -> None:
    """Figures 4 and 5 of a published run, from the curves that it published."""
    from tactile_core.figures.curves import policy_curves
    from tactile_core.figures.style import png

    for name, index, figure in CURVES:
        if (folder / figure).exists():
            curve = pd.read_csv(folder / f"{name}_curve.csv")
            (folder / figure).write_bytes(png(policy_curves(curve, index)))


def with_results(readme: str, results: str) -> str:
    """The README with the section between the two marks replaced."""
    before, _, rest = readme.partition(BEGIN)
    _, mark, after = rest.partition(END)
    if not mark:
        raise TactileError(f"{README} lacks the marks {BEGIN!r} and {END!r}")
    return f"{before}{BEGIN}\n\n{results}\n\n{END}{after}"


def main(name: str | None, note: str | None) -> None:
    """Publish the last run as `name`, if any, and write the pages of all that are published."""
    if name is not None:
        publish(name, note)
    for run in sorted(RESULTS.glob(f"*/{RUN}")):
        draw_curves(run.parent)
        (run.parent / "README.md").write_text(page(run.parent))
    README.write_text(with_results(README.read_text(), readme_part(shown_run())))
