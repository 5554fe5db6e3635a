"""Results as text: what stands at the end of a run and in the README."""

import numpy as np
import pandas as pd
import pytest

from tactile_core.evaluation.statistics import mean_curve, summarise_grasps, summarise_steps
from tactile_core.evaluation.tables import (
    above,
    around,
    around_percent,
    between,
    comparison_rows,
    grasp_rows,
    hyperparameter_rows,
    markdown_table,
    percent,
    policy_results,
    reconstruction_rows,
    step_rows,
    text_table,
)


def evaluation(index: str, policies: dict[str, float], count: int = 10) -> pd.DataFrame:
    """Every policy rises evenly to its last Jaccard; models differ by a point each."""
    table = pd.DataFrame(
        [
            (
                policy,
                0,
                f"m{model}-r0",
                f"m{model}",
                "mug",
                position,
                last * position / count + model,
            )
            for policy, last in policies.items()
            for model in range(4)
            for position in range(1, count + 1)
        ],
        columns=["policy", "seed", "sample_id", "model_id", "category", index, "jaccard"],
    )
    return table.assign(touches=table[index], missed=False, repeated=False, rays=3 * table[index])


POLICIES = {"random": 60.0, "even": 80.0, "total": 75.0, "oracle": 90.0}


def test_the_step_table_tells_the_jaccard_along_the_way_and_what_the_report_had() -> None:
    table = evaluation("step", POLICIES)
    rows = step_rows(mean_curve(table), summarise_steps(table)).set_index("policy")
    assert list(rows.index) == ["random", "even", "total", "oracle"]
    expected = "seeds|ray 1|ray 3|ray 5|ray 10|report|mean|gap at 10|gap, mean|hits"
    assert list(rows.columns) == expected.split("|")
    even = rows.loc["even"]
    assert even["ray 5"].startswith("41.5 ±")  # 80 / 2, and 1.5 for the mean over models
    assert even["gap at 10"] == "67 %"  # in every resample, as the models drawn are the same
    assert rows["report"].tolist() == ["≈ 60", "-", "≈ 80", "-"]
    assert (rows["hits"] == "10.0").all()


def test_the_interval_is_half_the_width_that_the_summary_has() -> None:
    table = evaluation("step", POLICIES)
    summary = summarise_steps(table)
    rows = step_rows(mean_curve(table), summary)
    half = (summary["mean_high"] - summary["mean_low"]) / 2
    assert rows["mean"].tolist() == [
        f"{mean:.1f} ±{width:.1f}" for mean, width in zip(summary["mean"], half, strict=True)
    ]


def test_short_evaluations_show_the_rays_they_have() -> None:
    table = evaluation("step", POLICIES, count=4)
    columns = step_rows(mean_curve(table), summarise_steps(table)).columns
    assert [name for name in columns if name.startswith("ray ")] == ["ray 1", "ray 3", "ray 4"]


def test_the_grasp_table_says_where_the_number_of_rays_is_a_lower_bound() -> None:
    table = evaluation("grasp", POLICIES)
    out_of_rays = (table["policy"] == "random") & (table["model_id"] == "m0") & (table["grasp"] > 8)
    table.loc[out_of_rays, "jaccard"] = np.nan
    rows = grasp_rows(mean_curve(table, "grasp"), summarise_grasps(table)).set_index("policy")
    assert rows.loc["random", ["rays", "reached"]].tolist() == ["≥ 30.0", "75.0 %"]
    assert rows.loc["even", ["rays", "reached"]].tolist() == ["30.0", "100 %"]
    assert rows.loc["random", "report"] == "≈ 90"


def test_a_share_that_is_not_whole_is_never_printed_as_whole() -> None:
    assert [percent(share) for share in (1, 0.9999, 0.5)] == ["100 %", "99.9 %", "50.0 %"]


def test_a_quantity_without_its_reference_is_a_dash() -> None:
    table = evaluation("step", {"even": 80.0, "total": 75.0})
    summary = summarise_steps(table)
    assert (step_rows(mean_curve(table), summary)[["gap at 10", "gap, mean"]] == "-").all(axis=None)
    compared = comparison_rows(summary).set_index("policy")
    assert compared.loc["total", "P(> even), end"] == "0.00"
    assert compared.loc["total", "above even, end"] == "-5.0"  # in every resample
    assert (compared[["P(> coverage), end", "above coverage, mean"]] == "-").all(axis=None)


def test_what_has_no_interval_is_a_dash() -> None:
    """A share that some resample leaves undefined, as on a test split of a few samples."""
    nan = float("nan")
    for laid_out in (around, above, around_percent, between):
        assert laid_out(0.8, nan, nan) == "-"


@pytest.mark.parametrize("index", ["step", "grasp"])
def test_with_one_model_of_each_class_there_is_no_interval_and_it_is_said(index) -> None:
    table = evaluation(index, POLICIES)
    alone = policy_results(table[table["model_id"] == "m2"], index, resamples=50, seed=0)
    assert "no interval over models" in alone.note
    words = pd.concat([alone.rows, alone.comparison]).astype(str)
    assert not words.apply(lambda cells: cells.str.contains("±| to |\\(0|\\(1")).any(axis=None)
    assert alone.rows.set_index("policy").loc["even", "mean"] == "46.0"  # 80 · 5.5 / 10 + 2
    several = policy_results(table, index, resamples=50, seed=0)
    assert several.note == "" and "±" in several.rows["mean"].iloc[0]


def test_the_reconstruction_table_stands_beside_the_report_s() -> None:
    table = pd.DataFrame(
        [
            (split, touches, 0.04, jaccard, 5)
            for split in ("test", "eval", "train")
            for touches, jaccard in ((None, 76.543), (3, 60.0))
        ],
        columns=["split", "touches", "loss", "jaccard", "samples"],
    ).astype({"touches": "Int64"})
    rows = reconstruction_rows(table).set_index("split")
    assert list(rows.index) == ["train", "eval", "test"]
    assert rows.loc["test"].tolist() == ["0.0400", "76.54", "0.0350", "77.48"]


def test_the_hyperparameters_stand_beside_the_report_s() -> None:
    rows = hyperparameter_rows(
        {"learning_rate": 0.0015, "batch_size": 32, "depth": 4, "channels": 16, "epochs": 40}
    )
    assert rows.loc[rows["hyperparameter"] == "learning rate"].to_numpy().tolist() == [
        ["learning rate", "0.0015", "2.074e-05"]
    ]
    assert len(rows) == 4


@pytest.mark.parametrize("layout", [text_table, markdown_table])
def test_columns_line_up(layout) -> None:
    rows = pd.DataFrame(
        {"policy": ["random", "pre_diff_miss"], "ray 1": ["9.0 ±0.1", "50.0 ±10.0"]}
    )
    expected = {
        text_table: (
            "policy              ray 1\n"
            "─────────────────────────\n"
            "random           9.0 ±0.1\n"
            "pre_diff_miss  50.0 ±10.0\n"
        ),
        markdown_table: (
            "| policy | ray 1 |\n"
            "| :-- | --: |\n"
            "| random | 9.0 ±0.1 |\n"
            "| pre_diff_miss | 50.0 ±10.0 |\n"
        ),
    }
    assert layout(rows) == expected[layout]
