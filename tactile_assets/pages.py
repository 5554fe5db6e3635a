"""A published run in words, tables and pictures: its page, and its part of the README.

Both are made from the files that `publish` wrote and nothing else, so a test can hold them to it.
"""

import json
from pathlib import Path

import pandas as pd

from tactile_assets.results import HEADINGS
from tactile_core.evaluation.tables import markdown_table

COMPARED = (
    "interquartile means; Jaccard points above the fixed rules `even` and `coverage` on the same "
    "samples; and the probability of being above them"
)
# A table's file → what stands above it, in the report's order.
IN_README = {
    "hyperparameters": "Hyperparameters (the report's Table I)",
    "reconstruction": "Reconstruction (Table II)",
    "per_step": HEADINGS["per_step"],
    "per_grasp": HEADINGS["per_grasp"],
    "attainable": HEADINGS["attainable"],
}
TABLES = IN_README | {
    "findings": "The report, finding by finding",
    "per_step_comparison": f"Compared, per step: {COMPARED}",
    "per_grasp_comparison": "Compared, per grasp",
    "real_per_step": HEADINGS["real_per_step"],
    "real_per_grasp": HEADINGS["real_per_grasp"],
    "real_per_step_comparison": "Compared on real meshes, per step",
    "real_per_grasp_comparison": "Compared on real meshes, per grasp",
}
PICTURES = {
    "figure_4.png": "Figure 4: mean Jaccard index after each ray",
    "figure_5.png": "Figure 5: mean Jaccard index at each touch",
    "figure_2.png": "Figure 2: a rollout, ray by ray",
    "figure_3.png": "Figure 3: rollouts with their rays, touches and predictions",
    "run.gif": "A rollout",
}


def readme_part(folder: Path) -> str:
    """The README's results, in markdown, from the published run in `folder`."""
    return "\n\n".join([how_it_was_made(folder), *tables(folder, IN_README)])


def page(folder: Path) -> str:
    """The README.md of a published run: every table and picture of it that is there."""
    pictures = [
        f"![{caption}]({file})" for file, caption in PICTURES.items() if (folder / file).exists()
    ]
    parts = [f"# {folder.name}", how_it_was_made(folder), *tables(folder, TABLES), *pictures]
    return "\n\n".join(parts) + "\n"


def how_it_was_made(folder: Path) -> str:
    about = json.loads((folder / "run.json").read_text())
    samples = f"{about['test samples']} test samples"
    if "real samples" in about:
        trained = "" if "TACTILE_SHAPENET" in about["command"] else ", trained on generated ones"
        samples += f", {about['real samples']} of real meshes{trained}"
    note = f" {about['note']}" if "note" in about else ""
    cast = f" (rays cast through {about['rays cast']})" if "rays cast" in about else ""
    return (
        f"`{about['command']}` at commit {about['commit']} on {about['machine']}{cast}, "
        f"{about['started']}: {about['minutes']} minutes; {samples}.{note}"
    )


def tables(folder: Path, headings: dict[str, str]) -> list[str]:
    """Heading, table and note of each of `headings` that the run has."""
    notes = json.loads((folder / "run.json").read_text()).get("notes", {})
    parts = []
    for name, heading in headings.items():
        file = folder / f"{name}.csv"
        if file.exists():
            rows = pd.read_csv(file, dtype=str, keep_default_na=False)
            parts += [f"**{heading}**", markdown_table(rows).strip()]
            if name in notes:
                parts.append(notes[name])
    return parts
