"""Means of the evaluation tables with 95 % intervals (report, section VII, Figures 4 and 5).

Intervals are bootstraps over base models and training seeds; `bootstrap.py` says how.
Shapes: S seeds of a policy, N test samples, T steps or grasps.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from tactile_core.errors import TactileError
from tactile_core.evaluation.bootstrap import (
    Weights,
    draw_weights,
    gap_closed,
    interquartile_mean,
    interval,
    points_above,
    probability_of_improvement,
    weighted_means,
)

REPORTS = ("diff", "total", "total_miss", "pre_diff_miss")  # the report's approaches
FIRST = ("random", "even", "sequence", "coverage", "uncertainty", *REPORTS)
OBSERVERS = ("observer", "observer_ahead")  # what can be attained without knowing the shape
LAST = (*OBSERVERS, "oracle")
BARS = ("even", "coverage")  # the fixed rules that a learned policy has to beat


def ordered(policies: Iterable[str]) -> list[str]:
    """Policies in the one order of all tables and figures: bars, the report's, ours, oracle."""
    names = set(policies)
    ours = sorted(names - set(FIRST) - set(LAST))
    return [name for name in (*FIRST, *ours, *LAST) if name in names]


@dataclass(frozen=True)
class Rollouts:
    """An evaluation table as arrays.

    positions : (T,) steps or grasps, 1 to T
    models, categories : (N,) int, the base model and the category of each sample
    columns : column name → policy → (S, N, T) float64
    """

    positions: np.ndarray
    models: np.ndarray
    categories: np.ndarray
    columns: dict[str, dict[str, np.ndarray]]

    @property
    def policies(self) -> list[str]:
        return ordered(self.columns["jaccard"])

    def weights(self, resamples: int, seed: int) -> Weights:
        trainings = {policy: len(values) for policy, values in self.columns["jaccard"].items()}
        return draw_weights(self.models, self.categories, trainings, resamples, seed)


def mean_curve(
    table: pd.DataFrame, index: str = "step", resamples: int = 2000, seed: int = 0
) -> pd.DataFrame:
    """Mean Jaccard of each policy at each `index`, "step" or "grasp".

    Columns: policy, the index, mean, low, high; for grasps also reached, the share (0 to 1) of
    rollouts that got so many touches. See `carried_forward` for how the others count.
    """
    rollouts = read_rollouts(table, index, ["jaccard"])
    weights = rollouts.weights(resamples, seed)
    curves = []
    for policy in rollouts.policies:
        jaccard = rollouts.columns["jaccard"][policy]
        mean, low, high = interval(
            weighted_means(carried_forward(jaccard), weights.samples, weights.seeds[policy])
        )
        curve = {
            "policy": policy,
            index: rollouts.positions,
            "mean": mean,
            "low": low,
            "high": high,
        }
        if index == "grasp":
            curve["reached"] = (~np.isnan(jaccard)).mean(axis=(0, 1))
        curves.append(pd.DataFrame(curve))
    return pd.concat(curves, ignore_index=True)


def summarise_steps(per_step: pd.DataFrame, resamples: int = 2000, seed: int = 0) -> pd.DataFrame:
    """One row per policy, in fixed order, from the per-step table.

    Each quantity is a column with its interval in `…_low` and `…_high`. Jaccard, 0 to 100:
    `last` (after the last ray), `mean` (over all rays), and their interquartile means `last_iqm`,
    `mean_iqm`. Shares, 0 to 1: `last_gap`, `mean_gap` (gap closed between random and oracle),
    `last_attained`, `mean_attained` (between random and the better of the ideal observers),
    and `last_over_even`, `mean_over_even`, `last_over_coverage`, `mean_over_coverage`
    (probability of improvement). `last_above_even` and so on: Jaccard points above that rule
    on the same samples. Counts per rollout: `hits` (rays that met the shape) and
    `touches` (distinct touches). A quantity whose reference policy is absent is null.
    """
    rollouts = read_rollouts(per_step, "step", ["jaccard", "missed", "touches"])
    weights = rollouts.weights(resamples, seed)
    counts = {
        "hits": {
            policy: (1 - missed).sum(axis=-1)
            for policy, missed in rollouts.columns["missed"].items()
        },
        "touches": {
            policy: touches[..., -1] for policy, touches in rollouts.columns["touches"].items()
        },
    }
    return _summary(rollouts, weights, counts)


def summarise_grasps(per_grasp: pd.DataFrame, resamples: int = 2000, seed: int = 0) -> pd.DataFrame:
    """One row per policy, in fixed order, from the per-grasp table.

    Columns as in `summarise_steps`, with grasps in the place of steps, and instead of `hits` and
    `touches`: `reached`, the share (0 to 1) of rollouts that got all touches, and `rays`, the
    mean number of rays cast until then. A rollout that never got there counts with
    the rays that it did cast, so where `reached` is below 1 `rays` is a lower bound.
    """
    rollouts = read_rollouts(per_grasp, "grasp", ["jaccard", "rays"])
    counts = {
        "rays": {policy: rays[..., -1] for policy, rays in rollouts.columns["rays"].items()},
        "reached": {
            policy: (~np.isnan(jaccard[..., -1])).astype(float)
            for policy, jaccard in rollouts.columns["jaccard"].items()
        },
    }
    for policy, jaccard in rollouts.columns["jaccard"].items():
        rollouts.columns["jaccard"][policy] = carried_forward(jaccard)
    return _summary(rollouts, rollouts.weights(resamples, seed), counts)


def _summary(
    rollouts: Rollouts, weights: Weights, counts: dict[str, dict[str, np.ndarray]]
) -> pd.DataFrame:
    """The columns that both summaries share, and a column for each of `counts`, policy → (S, N)."""
    jaccard = rollouts.columns["jaccard"]
    scores = {
        "last": {policy: values[..., -1] for policy, values in jaccard.items()},
        "mean": {policy: values.mean(axis=-1) for policy, values in jaccard.items()},
    }
    statistics: dict[str, dict[str, np.ndarray]] = {policy: {} for policy in rollouts.policies}
    for name, of_policy in {**scores, **counts}.items():
        means = {
            policy: weighted_means(values[..., None], weights.samples, weights.seeds[policy])[:, 0]
            for policy, values in of_policy.items()
        }
        for policy, columns in statistics.items():
            columns[name] = means[policy]
            if name not in scores:
                continue
            columns[f"{name}_iqm"] = interquartile_mean(
                of_policy[policy], weights.samples, weights.seeds[policy]
            )
            columns[f"{name}_gap"] = gap_closed(means, policy)
            columns[f"{name}_attained"] = gap_closed(means, policy, OBSERVERS)
            for bar in BARS:
                columns[f"{name}_above_{bar}"] = points_above(means, policy, bar)
                columns[f"{name}_over_{bar}"] = probability_of_improvement(
                    of_policy, policy, bar, weights
                )
    rows = []
    for policy, columns in statistics.items():
        row: dict[str, object] = {
            "policy": policy,
            "seeds": len(jaccard[policy]),
            "samples": len(rollouts.models),
        }
        for name, statistic in columns.items():
            row[name], row[f"{name}_low"], row[f"{name}_high"] = map(float, interval(statistic))
        rows.append(row)
    return pd.DataFrame(rows)


def read_rollouts(table: pd.DataFrame, index: str, columns: list[str]) -> Rollouts:
    """The named columns of an evaluation table as arrays, whatever the order of its rows.

    Raises `TactileError` unless every policy and seed has the same samples, each with every step.
    """
    if table.empty:
        raise TactileError("the evaluation table is empty: materialise the evaluation again")
    table = table.sort_values(["policy", "seed", "category", "model_id", "sample_id", index])
    positions = np.unique(table[index])
    runs = dict(list(table.groupby(["policy", "seed"], sort=False)))
    first = next(iter(runs.values()))
    samples = first.drop_duplicates("sample_id")
    for (policy, seed), rows in runs.items():
        whole = np.array_equal(rows[index], np.tile(positions, len(samples))) and np.array_equal(
            rows["sample_id"], np.repeat(samples["sample_id"].to_numpy(), len(positions))
        )
        if not whole:
            raise TactileError(
                f"the evaluation table lacks or repeats {index}s of {policy!r}, seed {seed}: "
                "materialise the evaluation again"
            )
    shape = (-1, len(samples), len(positions))
    return Rollouts(
        positions=positions,
        models=samples.groupby(["category", "model_id"]).ngroup().to_numpy(),
        categories=pd.factorize(samples["category"])[0],
        columns={
            column: {
                str(policy): rows[column].to_numpy(dtype=float, na_value=np.nan).reshape(shape)
                for policy, rows in table.groupby("policy", sort=False)
            }
            for column in columns
        },
    )


def carried_forward(jaccard: np.ndarray) -> np.ndarray:
    """(S, N, T) Jaccard per grasp with each null replaced by the last one before it.

    A rollout that runs out of rays counts as at its last touch: leaving it out would reward a
    policy for failing on hard shapes. What later misses may tell a U-Net that sees free space does
    not count. A rollout without any touch counts as 0.
    """
    reached = ~np.isnan(jaccard)
    last = np.maximum.accumulate(np.where(reached, np.arange(jaccard.shape[-1]), -1), axis=-1)
    held = np.take_along_axis(jaccard, np.maximum(last, 0), axis=-1)
    return np.where(last < 0, 0.0, held)
