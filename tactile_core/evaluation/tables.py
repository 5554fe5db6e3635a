"""The results as tables for the terminal and for markdown, beside the report's numbers.

Each `…_rows` function returns a DataFrame of strings, ready to print; `text_table` and
`markdown_table` lay one out. "±" is half the width of the 95 % interval, "gap" the gap closed
between random and oracle, "attained" that between random and the better ideal observer. What has
no interval is a dash: in some resample it was not defined.
"""

from collections.abc import Mapping
from typing import NamedTuple

import pandas as pd

from tactile_core.evaluation.statistics import (
    BARS,
    OBSERVERS,
    REPORTS,
    mean_curve,
    summarise_grasps,
    summarise_steps,
)

REPORT_TABLE_I = {"batch_size": 4, "learning_rate": 2.074e-5, "depth": 6, "channels": 128}
REPORT_TABLE_II = {  # split → loss, Jaccard index
    "train": (0.0276, 82.45),
    "eval": (0.0350, 77.37),
    "test": (0.0350, 77.48),
}
# After the tenth step (Figure 4) and the tenth touch (Figure 5), in the words of section VII.
REPORT_LAST = {
    "step": {"random": "≈ 60"} | dict.fromkeys(REPORTS, "≈ 80"),
    "grasp": {"random": "≈ 90"} | dict.fromkeys(REPORTS, "≈ 80") | {"pre_diff_miss": "> 80"},
}
NONE = "-"
LONG = 40  # characters, beyond which a cell is a sentence
NO_INTERVAL = "There is no interval over models: each class has one, which stands for no other."
SAME = 1e-9  # what is nearer than that in every resample has no interval


class PolicyResults(NamedTuple):
    """An evaluation in numbers, as `mean_curve` and `summarise_…` give them, and in words.

    note : what to know of its intervals; empty where they are over models
    """

    curve: pd.DataFrame
    summary: pd.DataFrame
    rows: pd.DataFrame
    comparison: pd.DataFrame
    note: str


def policy_results(table: pd.DataFrame, index: str, resamples: int, seed: int) -> PolicyResults:
    """What the rollouts of `table` come to, per "step" or per "grasp" (`index`)."""
    summarise, rows = {
        "step": (summarise_steps, step_rows),
        "grasp": (summarise_grasps, grasp_rows),
    }[index]
    curve, summary = mean_curve(table, index, resamples, seed), summarise(table, resamples, seed)
    note = NO_INTERVAL if one_model_of_each_class(table) else ""
    return PolicyResults(curve, summary, rows(curve, summary), comparison_rows(summary), note)


def one_model_of_each_class(table: pd.DataFrame) -> bool:
    """Whether models cannot be drawn, as there is only one in each category."""
    return bool((table.groupby("category")["model_id"].nunique() == 1).all())


def step_rows(curve: pd.DataFrame, summary: pd.DataFrame) -> pd.DataFrame:
    """Per step, from `mean_curve` and `summarise_steps`: Jaccard, gap closed, hits in ten rays."""
    hits = [f"{hits:.1f}" for hits in summary["hits"]]
    return policy_rows(curve, summary, "step").assign(hits=hits)


def grasp_rows(curve: pd.DataFrame, summary: pd.DataFrame) -> pd.DataFrame:
    """Per grasp, from `mean_curve` and `summarise_grasps`: also the rays needed for all touches.

    Where not every rollout reached them, the mean number of rays is a lower bound.
    """
    rays = [
        f"{'≥ ' if reached < 1 else ''}{number:.1f}"
        for number, reached in zip(summary["rays"], summary["reached"], strict=True)
    ]
    reached = [percent(share) for share in summary["reached"]]
    return policy_rows(curve, summary, "grasp").assign(rays=rays, reached=reached)


def policy_rows(curve: pd.DataFrame, summary: pd.DataFrame, index: str) -> pd.DataFrame:
    """The columns that both tables share: one row per policy, in the order of `summary`."""
    last = int(curve[index].max())
    word = {"step": "ray", "grasp": "touch"}[index]
    at = curve.set_index(["policy", index])
    rows = []
    for _, policy in summary.iterrows():
        name = policy["policy"]
        row = {"policy": name, "seeds": str(policy["seeds"])}
        for position in sorted({1, 3, 5, last}):
            if position <= last:
                point = at.loc[(name, position)]
                row[f"{word} {position}"] = around(point["mean"], point["low"], point["high"])
        row["report"] = REPORT_LAST[index].get(name, NONE)
        row["mean"] = around(*quantity(policy, "mean"))
        row[f"gap at {last}"] = around_percent(*quantity(policy, "last_gap"))
        row["gap, mean"] = around_percent(*quantity(policy, "mean_gap"))
        if set(OBSERVERS) & set(summary["policy"]):
            row[f"attained at {last}"] = around_percent(*quantity(policy, "last_attained"))
            row["attained, mean"] = around_percent(*quantity(policy, "mean_attained"))
        rows.append(row)
    return pd.DataFrame(rows)


def comparison_rows(summary: pd.DataFrame) -> pd.DataFrame:
    """Interquartile means, and how far and how probably a policy is above the fixed rules.

    Each after the last ray or touch ("end"), and for the mean over all of them ("mean").
    """
    return pd.DataFrame(
        {
            "policy": policy["policy"],
            "IQM, end": around(*quantity(policy, "last_iqm")),
            "IQM, mean": around(*quantity(policy, "mean_iqm")),
        }
        | {
            column: text
            for bar in BARS
            for score, when in (("last", "end"), ("mean", "mean"))
            for column, text in (
                (f"above {bar}, {when}", above(*quantity(policy, f"{score}_above_{bar}"))),
                (f"P(> {bar}), {when}", between(*quantity(policy, f"{score}_over_{bar}"))),
            )
        }
        for _, policy in summary.iterrows()
    )


def reconstruction_rows(reconstruction: pd.DataFrame) -> pd.DataFrame:
    """Table II: loss and Jaccard of each split over the mix of touches, beside the report's.

    Of several U-Nets it is their mean.
    """
    mixed = reconstruction[reconstruction["touches"].isna()]
    mix = mixed.groupby("split")[["loss", "jaccard"]].mean()
    return pd.DataFrame(
        {
            "split": split,
            "loss": f"{mix.loc[split, 'loss']:.4f}",
            "Jaccard": f"{mix.loc[split, 'jaccard']:.2f}",
            "report: loss": f"{loss:.4f}",
            "report: Jaccard": f"{jaccard:.2f}",
        }
        for split, (loss, jaccard) in REPORT_TABLE_II.items()
    )


def hyperparameter_rows(chosen: Mapping[str, float]) -> pd.DataFrame:
    """Table I: the hyperparameters that the search chose, beside the report's."""
    return pd.DataFrame(
        {
            "hyperparameter": name.replace("_", " "),
            "chosen": f"{chosen[name]:.4g}",
            "report": f"{value:.4g}",
        }
        for name, value in REPORT_TABLE_I.items()
    )


def quantity(row: pd.Series, name: str) -> tuple[float, float, float]:
    """A quantity of a summary row with its interval."""
    return row[name], row[f"{name}_low"], row[f"{name}_high"]


def around(value: float, low: float, high: float) -> str:
    """87.5 ±1.0; without ± where it is the same in every resample, here and below"""
    if pd.isna(low):
        return NONE
    return f"{value:.1f}" + (f" ±{(high - low) / 2:.1f}" if high - low > SAME else "")


def above(value: float, low: float, high: float) -> str:
    """+3.4 (2.9 to 3.9), in Jaccard points"""
    if pd.isna(low):
        return NONE
    return f"{value:+.1f}" + (f" ({low:.1f} to {high:.1f})" if high - low > SAME else "")


def around_percent(value: float, low: float, high: float) -> str:
    """A share as 82 ±3 %"""
    if pd.isna(low):
        return NONE
    return f"{100 * value:.0f}" + (f" ±{50 * (high - low):.0f} %" if high - low > SAME else " %")


def between(value: float, low: float, high: float) -> str:
    """0.73 (0.69-0.78)"""
    if pd.isna(low):
        return NONE
    return f"{value:.2f}" + (f" ({low:.2f}-{high:.2f})" if high - low > SAME else "")


def percent(share: float) -> str:
    """A share as 97.5 %, and 100 % only where nothing is missing."""
    return "100 %" if share == 1 else f"{min(100 * share, 99.9):.1f} %"


def markdown_table(rows: pd.DataFrame) -> str:
    """A GitHub table: its first column and sentences on the left, all others on the right."""
    cells = rows.astype(str)
    sentences = [bool((cells[name].map(len) > LONG).any()) for name in rows.columns[1:]]
    lines = [
        list(rows.columns),
        [":--", *(":--" if sentence else "--:" for sentence in sentences)],
        *cells.to_numpy().tolist(),
    ]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines) + "\n"


def text_table(rows: pd.DataFrame) -> str:
    """The same for the terminal, in columns of even width under a line."""
    cells = [list(rows.columns), *rows.astype(str).to_numpy().tolist()]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    lines = [
        "  ".join(
            cell.ljust(width) if column == 0 else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in cells
    ]
    return "\n".join([lines[0], "─" * (sum(widths) + 2 * len(widths) - 2), *lines[1:]]) + "\n"
