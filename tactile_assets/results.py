"""The results on the screen, as `make run` ends: `tactile results`."""

from collections.abc import Mapping
from typing import Any

import pandas as pd

from tactile_assets.config import PROFILE
from tactile_assets.provenance import how_made, own_instance
from tactile_assets.resources import Store
from tactile_core.evaluation.tables import (
    PolicyResults,
    policy_results,
    reconstruction_rows,
    text_table,
)
from tactile_core.parquet import read_table

HEADINGS = {
    "per_step": "Per step: Jaccard index after each ray (Figure 4)",
    "per_grasp": "Per grasp: Jaccard index at each touch (Figure 5)",
    "attainable": "Per step, beside the ideal observers on the same samples",
    "real_per_step": "Per step, on real meshes",
    "real_per_grasp": "Per grasp, on real meshes",
}


def main() -> None:
    """Table II, the per-step and the per-grasp table, and where to look further."""
    store = Store.from_environment()
    reconstruction = read_table(store.path("reconstruction_evaluation.parquet"))
    evaluations = stored_evaluations(store)
    with own_instance() as instance:
        made = {name: how_made(instance, f"{name}_evaluation") for name in evaluations}

    heading("Reconstruction (the report's Table II)")
    print(text_table(reconstruction_rows(reconstruction)))
    for name, table in evaluations.items():
        heading(HEADINGS[name])
        results = results_of(table, made[name])
        print(text_table(results.rows))
        if results.note:
            print(results.note)

    samples = f"{evaluations['per_step']['sample_id'].nunique()} test samples"
    if "real_per_step" in evaluations:
        samples += f", {evaluations['real_per_step']['sample_id'].nunique()} real ones"
    print(
        f"Profile {made['per_step']['profile']}, {samples}; ± is half a 95 % interval over "
        "training seeds and models."
    )
    print(f"Tables:   {store.path()}/*.parquet")
    print(f"Figures:  {store.path('figures')}")
    print("Browser:  make ui (lineage, pictures, checks, logs)")


def stored_evaluations(store: Store) -> dict[str, pd.DataFrame]:
    """The rollouts "per_step" and "per_grasp"; "attainable", where the profile has ideal observers
    and that is stored; and, where TACTILE_REAL is set and both of those evaluations are stored,
    "real_per_step" and "real_per_grasp"."""
    files = {name: store.path(f"{name}_evaluation.parquet") for name in HEADINGS}
    # Read first: a store that is out of reach is told best by what must be there.
    tables = {name: read_table(files[name]) for name in ("per_step", "per_grasp")}
    real = [name for name in files if name.startswith("real_")]
    for names, wanted in ((real, PROFILE.real), (["attainable"], PROFILE.attainable)):
        if wanted and all(files[name].exists() for name in names):
            tables |= {name: read_table(files[name]) for name in names}
    return {name: tables[name] for name in HEADINGS if name in tables}


def results_of(table: pd.DataFrame, made: Mapping[str, Any]) -> PolicyResults:
    """What the rollouts of an evaluation come to, with the bootstrap that it was `made` with."""
    index = "step" if "step" in table else "grasp"
    return policy_results(table, index, **made["bootstrap"])


def heading(text: str) -> None:
    print(f"\n{text}\n")
