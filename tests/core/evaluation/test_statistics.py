"""Means, intervals and comparisons of the evaluation tables."""

import itertools
import tracemalloc

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import mannwhitneyu, trim_mean

from tactile_core.errors import TactileError
from tactile_core.evaluation.statistics import (
    carried_forward,
    mean_curve,
    ordered,
    read_rollouts,
    summarise_grasps,
    summarise_steps,
)


def table(jaccard: dict[str, np.ndarray], models: list[str], index: str = "step") -> pd.DataFrame:
    """An evaluation table from (S, N, T) Jaccard indices of each policy; sample n is of models[n].

    Every second model is a mug, every ray hits, and each touch takes two rays.
    """
    distinct = sorted(set(models))
    rows = [
        {
            "policy": policy,
            "seed": seed,
            "sample_id": f"{models[sample]}-r{sample}",
            "model_id": models[sample],
            "category": ("mug", "bottle")[distinct.index(models[sample]) % 2],
            index: step + 1,
            "jaccard": values[seed, sample, step],
            "touches": step + 1,
            "missed": False,
            "repeated": False,
            "rays": 2 * (step + 1),
        }
        for policy, values in jaccard.items()
        for seed, sample, step in itertools.product(*map(range, values.shape))
    ]
    return pd.DataFrame(rows)


def random_table(policies: dict[str, int], models: int = 8, steps: int = 3, seed: int = 0):
    """Noise for each policy, with so many seeds, on two samples of each model."""
    generator = np.random.default_rng(seed)
    names = [f"m{model:02}" for model in range(models)] * 2
    return table(
        {
            policy: generator.uniform(20, 90, (seeds, len(names), steps))
            for policy, seeds in policies.items()
        },
        names,
    )


def test_policies_stand_in_one_order_whatever_the_table_s() -> None:
    assert ordered(["scorer", "oracle", "diff", "even", "beta", "random"]) == [
        "random", "even", "diff", "beta", "scorer", "oracle",
    ]  # fmt: skip


def test_the_curve_is_the_plain_mean_and_lies_inside_its_interval() -> None:
    rows = random_table({"random": 1, "diff": 3})
    curve = mean_curve(rows).set_index(["policy", "step"])
    plain = rows.groupby(["policy", "step"])["jaccard"].mean()
    pd.testing.assert_series_equal(
        curve["mean"], plain.reindex(curve.index), check_names=False, rtol=1e-12
    )
    assert ((curve["low"] < curve["mean"]) & (curve["mean"] < curve["high"])).all()


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_order_of_rows_changes_nothing(seed: int) -> None:
    rows = random_table({"random": 1, "diff": 2, "oracle": 1}, models=4)
    shuffled = rows.sample(frac=1, random_state=seed)
    pd.testing.assert_frame_equal(
        summarise_steps(rows, resamples=20), summarise_steps(shuffled, resamples=20)
    )


def test_a_policy_keeps_its_interval_when_others_join_the_table() -> None:
    rows = random_table({"random": 1, "diff": 3, "oracle": 1})
    alone = mean_curve(rows[rows["policy"] == "diff"])
    among = mean_curve(rows).query("policy == 'diff'").reset_index(drop=True)
    pd.testing.assert_frame_equal(alone, among)


def test_another_seed_draws_other_resamples() -> None:
    rows = random_table({"random": 1})
    assert not mean_curve(rows, seed=0)["low"].equals(mean_curve(rows, seed=1)["low"])


def test_the_interval_of_a_mean_over_models_is_as_wide_as_theory_says() -> None:
    """Per category: standard error sd/√n over models (with sd of the population, as resampled)."""
    generator = np.random.default_rng(3)
    models = [f"m{model:02}" for model in range(60)]
    values = generator.normal(70, 8, (1, 60, 1))
    mean, low, high = mean_curve(table({"even": values}, models), resamples=20_000).loc[
        0, ["mean", "low", "high"]
    ]
    variance = np.mean([values[0, half::2].var() for half in (0, 1)]) / 60
    assert high - mean == pytest.approx(1.96 * variance**0.5, rel=0.05)
    assert mean - low == pytest.approx(1.96 * variance**0.5, rel=0.05)


def test_more_rotations_of_the_same_models_do_not_narrow_the_interval() -> None:
    """Rotations of a model travel together: ten equal copies say no more than one."""
    values = np.random.default_rng(0).normal(70, 8, (1, 12, 2))
    models = [f"m{model:02}" for model in range(12)]
    once = mean_curve(table({"even": values}, models))
    tenfold = mean_curve(table({"even": np.tile(values, (1, 10, 1))}, models * 10))
    pd.testing.assert_frame_equal(once, tenfold)


def test_a_difference_between_categories_alone_gives_no_width() -> None:
    """The splits fix how many models of each category there are, so resamples do too."""
    values = np.tile([[[60.0], [90.0]]], (1, 4, 1))  # every bottle 90, every mug 60
    curve = mean_curve(table({"even": values}, [f"m{model}" for model in range(8)]))
    assert (curve[["low", "mean", "high"]].iloc[0] == 75).all()


def test_training_seeds_that_differ_widen_the_interval() -> None:
    """Models all alike, seeds 60, 70 and 80: the extremes of three draws with replacement."""
    values = np.full((3, 6, 1), 70.0) + np.array([-10, 0, 10])[:, None, None]
    mean, low, high = mean_curve(table({"diff": values}, list("abcdef"))).loc[
        0, ["mean", "low", "high"]
    ]
    assert (mean, low, high) == (70, 60, 80)


def test_gap_closed_runs_from_random_to_oracle_and_is_paired() -> None:
    """A policy that lies halfway on each sample closes exactly half, in every resample."""
    generator = np.random.default_rng(1)
    low, high = generator.uniform(30, 60, (1, 9, 4)), generator.uniform(70, 95, (1, 9, 4))
    rows = table({"random": low, "oracle": high, "even": (low + high) / 2}, list("abcabcabc"))
    summary = summarise_steps(rows, resamples=50).set_index("policy")
    for gap in ("last_gap", "mean_gap"):
        for bound in ("", "_low", "_high"):
            assert summary[gap + bound].to_dict() == pytest.approx(
                {"random": 0, "even": 0.5, "oracle": 1}
            )


def test_the_interquartile_mean_is_scipy_s_trimmed_mean() -> None:
    rows = random_table({"diff": 3}, models=8)  # 48 rollouts: a quarter is a whole number
    last = rows[rows["step"] == 3]["jaccard"]
    mean = rows.groupby(["seed", "sample_id"])["jaccard"].mean()
    summary = summarise_steps(rows, resamples=10).iloc[0]
    assert summary["last_iqm"] == pytest.approx(trim_mean(last, 0.25))
    assert summary["mean_iqm"] == pytest.approx(trim_mean(mean, 0.25))


def test_the_interquartile_mean_s_interval_equals_drawing_rows_again_and_again() -> None:
    """Weights give the interval that resamples with really repeated rows give."""
    rows = random_table({"even": 1}, models=20, steps=1)
    summary = summarise_steps(rows, resamples=4000).iloc[0]
    generator = np.random.default_rng(5)
    by_category = [
        [group["jaccard"].to_numpy() for _, group in of_category.groupby("model_id")]
        for _, of_category in rows.groupby("category")
    ]
    drawn = [
        trim_mean(
            np.concatenate(
                [
                    models[index]
                    for models in by_category
                    for index in generator.integers(len(models), size=len(models))
                ]
            ),
            0.25,
        )
        for _ in range(4000)
    ]
    low, high = np.percentile(drawn, [2.5, 97.5])
    assert summary["last_iqm_low"] == pytest.approx(low, abs=0.7)
    assert summary["last_iqm_high"] == pytest.approx(high, abs=0.7)


def test_the_probability_of_improvement_is_the_mean_mann_whitney_u() -> None:
    """As rliable computes it: U / (S · S') of each sample, averaged over samples."""
    generator = np.random.default_rng(2)
    scores = {
        "even": generator.integers(50, 60, (2, 8, 1)).astype(float),  # integers, so that some tie
        "diff": generator.integers(50, 60, (3, 8, 1)).astype(float),
    }
    expected = np.mean(
        [
            mannwhitneyu(scores["diff"][:, sample, 0], scores["even"][:, sample, 0]).statistic / 6
            for sample in range(8)
        ]
    )
    summary = summarise_steps(table(scores, list("abcdefgh"))).set_index("policy")
    row = summary.loc["diff"]
    assert row["last_over_even"] == pytest.approx(expected)
    assert row["last_over_even_low"] < expected < row["last_over_even_high"]
    assert np.isnan(summary.loc["even", "last_over_even"])


def test_points_above_a_rule_are_taken_on_the_same_samples() -> None:
    """Where a policy is two points better on every sample the interval has no width."""
    generator = np.random.default_rng(4)
    even = generator.uniform(20, 80, (1, 12, 3))
    scores = {"even": even, "diff": np.concatenate([even + 1, even + 3])[[0, 1]]}
    models = [model for model in "abcdef" for _ in range(2)]
    row = summarise_steps(table(scores, models)).set_index("policy").loc["diff"]
    assert row["mean_above_even"] == pytest.approx(2)
    assert row["mean_above_even_low"] == pytest.approx(1)  # both seeds drawn alike
    scores["diff"] = even + 2
    row = summarise_steps(table(scores, models)).set_index("policy").loc["diff"]
    assert row["last_above_even_low"] == pytest.approx(row["last_above_even_high"])


def test_without_random_or_oracle_there_is_no_gap_to_close() -> None:
    summary = summarise_steps(random_table({"diff": 1, "oracle": 1}), resamples=10)
    assert summary[["last_gap", "mean_gap_low", "last_over_coverage"]].isna().all(axis=None)


def test_hits_count_rays_that_met_the_shape_even_where_they_repeat_a_touch() -> None:
    rows = random_table({"even": 1}, steps=3)
    rows["missed"] = rows["step"] == 1
    rows["repeated"] = rows["step"] == 3
    rows["touches"] = rows["step"].map({1: 0, 2: 1, 3: 1})
    summary = summarise_steps(rows, resamples=10).iloc[0]
    assert (summary["hits"], summary["touches"]) == (2, 1)


def test_a_grasp_that_was_not_reached_keeps_the_last_jaccard() -> None:
    null = np.nan
    jaccard = np.array([[[40, 50, null], [null, null, null], [40, 50, 60]]])
    assert carried_forward(jaccard).tolist() == [[[40, 50, 50], [0, 0, 0], [40, 50, 60]]]


def test_grasps_report_rays_and_the_share_of_rollouts_that_got_there() -> None:
    values = np.array([[[40.0, 50.0], [60.0, np.nan]]])
    rows = table({"random": values}, ["a", "b"], index="grasp")
    rows.loc[rows["jaccard"].isna(), "rays"] = 100
    summary = summarise_grasps(rows, resamples=10).iloc[0]
    assert summary["reached"] == 0.5
    assert summary["rays"] == (4 + 100) / 2
    assert summary["last"] == (50 + 60) / 2
    curve = mean_curve(rows, "grasp", resamples=10)
    assert curve["reached"].tolist() == [1, 0.5]
    assert curve["mean"].tolist() == [50, 55]


def test_grasps_are_counted_over_seeds_samples_and_grasps_of_any_number() -> None:
    null = np.nan
    values = np.array(
        [
            [[10, 20, 30, 40], [50, null, null, null], [null, null, null, null]],
            [[20, 30, 40, 50], [60, 70, null, null], [10, 20, 30, null]],
        ],
        dtype=float,
    )
    rows = table({"random": values}, ["a", "b", "a"], index="grasp")
    curve = mean_curve(rows, "grasp", resamples=10)
    assert curve["reached"].tolist() == pytest.approx([5 / 6, 4 / 6, 3 / 6, 2 / 6])
    assert curve["mean"].tolist() == pytest.approx([25, 190 / 6, 220 / 6, 240 / 6])
    summary = summarise_grasps(rows, resamples=10).iloc[0]
    assert (summary["seeds"], summary["samples"]) == (2, 3)
    assert summary["reached"] == pytest.approx(2 / 6)
    assert summary["rays"] == pytest.approx(8)
    assert summary["last"] == pytest.approx(240 / 6)
    assert summary["mean"] == pytest.approx(np.mean([25, 190 / 6, 220 / 6, 240 / 6]))


def test_touches_are_those_held_after_the_last_ray() -> None:
    rows = random_table({"even": 1}, steps=4)
    rows["touches"] = rows["step"].map({1: 1, 2: 2, 3: 4, 4: 7})
    assert summarise_steps(rows, resamples=10)["touches"].tolist() == [7]


def test_the_better_of_two_observers_is_what_can_be_attained() -> None:
    """Halfway from random to it is a half, sample by sample, whichever of the two it is."""
    generator = np.random.default_rng(6)
    low, high = generator.uniform(30, 60, (1, 9, 4)), generator.uniform(70, 95, (1, 9, 4))
    scores = {"random": low, "observer": high, "observer_ahead": low, "even": (low + high) / 2}
    for names in (("observer", "observer_ahead"), ("observer_ahead", "observer")):
        scores |= dict(zip(names, (high, low), strict=True))
        summary = summarise_steps(table(scores, list("abcabcabc")), resamples=20)
        assert summary["policy"].tolist() == ["random", "even", "observer", "observer_ahead"]
        row = summary.set_index("policy").loc["even"]
        assert row[["last_attained", "mean_attained_low"]].tolist() == pytest.approx([0.5, 0.5])


@pytest.mark.parametrize(
    ("summarise", "index"),
    [(mean_curve, "step"), (summarise_steps, "step"), (summarise_grasps, "grasp")],
)
def test_intervals_are_of_2000_resamples_unless_another_number_is_given(summarise, index) -> None:
    rows = random_table({"random": 1, "diff": 2}, models=30).rename(columns={"step": index})
    named = {"index": index} if summarise is mean_curve else {}
    expected = summarise(rows, resamples=2000, seed=0, **named)
    pd.testing.assert_frame_equal(summarise(rows, **named), expected, check_exact=True)


@pytest.mark.parametrize("damage", ["lost", "twice", "other sample", "empty"])
def test_an_incomplete_table_is_refused_in_one_line(damage: str) -> None:
    rows = random_table({"random": 1, "diff": 2})
    if damage == "lost":
        rows = rows.drop(index=rows.index[-1])
    elif damage == "twice":
        rows = pd.concat([rows.drop(index=rows.index[-1]), rows.iloc[[-2]]])
    elif damage == "other sample":
        rows.loc[rows.index[-3:], "sample_id"] = "m99-r0"
    else:
        rows = rows.iloc[:0]
    with pytest.raises(TactileError, match="materialise the evaluation again") as error:
        read_rollouts(rows, "step", ["jaccard"])
    assert "\n" not in str(error.value)


def test_the_whole_laptop_evaluation_is_summarised_in_little_memory() -> None:
    """12 policies × 3 seeds × 355 samples × 10 steps with 2000 resamples."""
    models, samples, steps = 71, 355, 10
    count = samples * steps
    one = pd.DataFrame(
        {
            "sample_id": np.repeat([f"s{n:03}" for n in range(samples)], steps),
            "model_id": np.repeat([f"m{n % models:02}" for n in range(samples)], steps),
            "category": np.repeat(
                [("mug", "bottle")[n % models % 2] for n in range(samples)], steps
            ),
            "step": np.tile(np.arange(1, 11), samples),
            "touches": 1,
            "missed": False,
        }
    )
    generator = np.random.default_rng(0)
    rows = pd.concat(
        [
            one.assign(policy=policy, seed=seed, jaccard=generator.uniform(0, 100, count))
            for policy in ["random", "even", "coverage", "oracle", *map(str, range(8))]
            for seed in range(3)
        ]
    )
    tracemalloc.start()
    try:
        summarise_steps(rows)
        mean_curve(rows)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 2**25  # bytes: resamples are weighed in blocks
