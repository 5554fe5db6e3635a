"""The results on the screen, as `make run` ends: `python -m tactile_assets.results`."""

import sys

from tactile_assets.config import PROFILE
from tactile_assets.resources import Store
from tactile_core.errors import TactileError
from tactile_core.evaluation.statistics import mean_curve, summarise_grasps, summarise_steps
from tactile_core.evaluation.tables import (
    grasp_rows,
    reconstruction_rows,
    step_rows,
    text_table,
)
from tactile_core.files import read_table


def main() -> None:
    """Table II, the per-step and the per-grasp table, and where to look further."""
    store = Store.from_environment()
    reconstruction = read_table(store.path("reconstruction_evaluation.parquet"))
    per_step = read_table(store.path("per_step_evaluation.parquet"))
    per_grasp = read_table(store.path("per_grasp_evaluation.parquet"))
    drawn = PROFILE.per_step.resamples, PROFILE.per_step.seed

    heading("Reconstruction (the report's Table II)")
    print(text_table(reconstruction_rows(reconstruction)))
    heading("Per step: Jaccard index after each ray (Figure 4)")
    steps = mean_curve(per_step, "step", *drawn), summarise_steps(per_step, *drawn)
    print(text_table(step_rows(*steps)))
    heading("Per grasp: Jaccard index at each touch (Figure 5)")
    grasps = mean_curve(per_grasp, "grasp", *drawn), summarise_grasps(per_grasp, *drawn)
    print(text_table(grasp_rows(*grasps)))

    samples = per_step["sample_id"].nunique()
    print(f"Profile {PROFILE.name}, {samples} test samples; ± is half a 95 % interval over models.")
    print(f"Tables:   {store.path()}/*.parquet")
    print(f"Figures:  {store.path('figures')}")
    print("Browser:  make ui, then http://localhost:3000 (lineage, pictures, checks, logs)")


def heading(text: str) -> None:
    print(f"\n{text}\n")


if __name__ == "__main__":
    try:
        main()
    except TactileError as error:
        sys.exit(str(error))
