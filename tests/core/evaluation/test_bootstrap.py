"""Resamples of models within categories, and of training seeds, and what is computed on them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

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

RESAMPLES = 40


@settings(deadline=None, max_examples=25)
@given(
    st.lists(st.integers(1, 5), min_size=1, max_size=4),
    st.integers(1, 3),
    st.dictionaries(st.sampled_from(["gain", "even", "total"]), st.integers(1, 4)),
    st.integers(0, 2**32 - 1),
)
def test_each_category_keeps_its_weight_and_all_samples_of_a_model_share_one(
    models_of_each, rotations, trainings, seed
):
    categories = np.repeat(np.arange(len(models_of_each)), models_of_each)
    models = np.tile(np.arange(len(categories)), rotations)
    weights = draw_weights(models, np.tile(categories, rotations), trainings, RESAMPLES, seed)
    assert weights.samples.shape == (1 + RESAMPLES, len(models))
    assert (weights.samples[0] == 1).all()  # as it was, before any is drawn
    of_model = weights.samples.reshape(1 + RESAMPLES, rotations, -1)
    assert (of_model == of_model[:, :1]).all()
    for category, count in enumerate(models_of_each):
        drawn = of_model[:, 0][:, categories == category]
        assert (drawn.sum(axis=1) == count).all()
        assert (drawn >= 0).all() and (drawn == drawn.round()).all()
    assert set(weights.seeds) == set(trainings)
    for policy, count in trainings.items():
        assert weights.seeds[policy].shape == (1 + RESAMPLES, count)
        assert (weights.seeds[policy][0] == 1).all()
        assert (weights.seeds[policy].sum(axis=1) == count).all()


def test_every_model_is_as_likely_as_any_other_in_its_category():
    models, categories = np.arange(9), np.array([0] * 2 + [1] * 3 + [2] * 4)
    weights = draw_weights(models, categories, {"gain": 5}, 4000, seed=1)
    np.testing.assert_allclose(weights.samples[1:].mean(axis=0), 1, atol=0.08)
    np.testing.assert_allclose(weights.seeds["gain"][1:].mean(axis=0), 1, atol=0.08)


def test_draws_repeat_and_differ_between_categories_counts_and_seeds():
    def draw(seed, **trainings):
        return draw_weights(np.arange(8), np.repeat([0, 1], 4), trainings, RESAMPLES, seed)

    one, again, other = draw(3, gain=4, even=4, total=3), draw(3, gain=4), draw(4, gain=4)
    np.testing.assert_array_equal(one.samples, again.samples)
    np.testing.assert_array_equal(one.seeds["gain"], again.seeds["gain"])
    assert (one.samples[1:, :4] != one.samples[1:, 4:]).any()
    assert (one.seeds["gain"][:, :3] != one.seeds["total"]).any()
    assert (one.samples != other.samples).any()
    assert (one.seeds["gain"] != other.seeds["gain"]).any()


def test_what_a_unet_does_to_all_policies_of_its_seed_is_in_no_comparison():
    """A U-Net that is better by any number of points is so for both, and moves neither's lead."""
    drawn = draw_weights(np.zeros(1, int), np.zeros(1, int), {"gain": 3, "even": 3}, RESAMPLES, 0)
    of_unet = np.array([60.0, 75.0, 90.0])[:, None, None]  # (S, N, K)
    means = {
        policy: weighted_means(of_unet + lead, drawn.samples, drawn.seeds[policy])[:, 0]
        for policy, lead in {"gain": 2, "even": 0}.items()
    }
    assert np.ptp(means["gain"]) > 10  # each on its own is as uncertain as the U-Net
    np.testing.assert_allclose(points_above(means, "gain", "even"), 2)


@settings(deadline=None, max_examples=25)
@given(st.integers(1, 3), st.integers(1, 5), st.integers(1, 3), st.integers(0, 999))
def test_weighted_statistics_are_those_of_the_rows_drawn_as_often(seeds, samples, columns, seed):
    rng = np.random.default_rng(seed)
    values = rng.uniform(0, 100, (seeds, samples, columns))
    drawn = draw_weights(np.arange(samples), np.zeros(samples, int), {"p": seeds}, 70, seed)
    means = weighted_means(values, drawn.samples, drawn.seeds["p"])
    middle = interquartile_mean(values[..., 0], drawn.samples, drawn.seeds["p"])
    assert means.shape == (71, columns) and middle.shape == (71,)
    for row in (0, 1, 63, 64, 70):  # on both sides of a block of 64
        rows = np.repeat(np.arange(seeds), drawn.seeds["p"][row].astype(int))
        some = np.repeat(np.arange(samples), drawn.samples[row].astype(int))
        repeated = values[rows][:, some].reshape(-1, columns)
        np.testing.assert_allclose(means[row], repeated.mean(axis=0))
        four = np.sort(np.repeat(repeated[:, 0], 4))  # so that quarters are whole rows
        quarter = len(four) // 4
        assert middle[row] == pytest.approx(four[quarter:-quarter].mean())


def test_the_gap_is_closed_from_random_at_0_to_the_oracle_at_1():
    means = {
        "random": np.array([10.0, 20.0, 30.0, 20.0]),
        "oracle": np.array([30.0, 60.0, 30.0, 20.5]),  # however little that is
        "own": np.array([15.0, 60.0, 40.0, 20.25]),
    }
    np.testing.assert_array_equal(gap_closed(means, "own"), [0.25, 1, np.nan, 0.5])
    np.testing.assert_array_equal(gap_closed(means, "random"), [0, 0, np.nan, 0])
    two = {name: means[name] for name in ("random", "oracle")}
    assert gap_closed(two, "oracle").tolist()[:2] == [1, 1]
    for lacking in ("random", "oracle"):
        rest = {name: value for name, value in means.items() if name != lacking}
        assert np.isnan(gap_closed(rest, "own")).all()


def test_points_above_a_rule_are_none_for_the_rule_itself_or_where_it_is_absent():
    means = {"even": np.array([50.0, 60.0]), "own": np.array([55.0, 50.0])}
    assert points_above(means, "own", "even").tolist() == [5, -10]
    assert np.isnan(points_above(means, "even", "even")).all()
    assert np.isnan(points_above(means, "own", "coverage")).all()


def test_improvement_counts_pairs_of_runs_on_the_same_sample_and_ties_half():
    scores = {"own": np.array([[1.0, 5.0], [3.0, 5.0]]), "even": np.array([[2.0, 5.0]])}
    weights = Weights(
        samples=np.array([[1.0, 1.0], [2.0, 0.0], [0.0, 2.0]]),
        seeds={"own": np.array([[1.0, 1.0], [2.0, 0.0], [1.0, 1.0]]), "even": np.ones((3, 1))},
    )
    improved = probability_of_improvement(scores, "own", "even", weights)
    assert improved.tolist() == [0.5, 0, 0.5]
    assert probability_of_improvement(scores, "even", "own", weights).tolist() == [0.5, 1, 0.5]
    assert np.isnan(probability_of_improvement(scores, "own", "own", weights)).all()
    assert np.isnan(probability_of_improvement(scores, "own", "oracle", weights)).all()


def test_runs_with_one_unet_are_compared_with_each_other():
    """A policy that is a point better with every U-Net is better, however far those are apart."""
    even = np.array([[70.0, 70.0], [75.0, 75.0], [80.0, 80.0]])
    weights = Weights(
        samples=np.ones((2, 2)),
        seeds={name: np.array([[1.0, 1.0, 1.0], [2.0, 0.0, 1.0]]) for name in ("own", "even")},
    )
    improved = probability_of_improvement({"own": even + 1, "even": even}, "own", "even", weights)
    assert improved.tolist() == [1, 1]


def test_an_interval_holds_the_middle_95_percent_of_the_resamples_beside_the_value():
    value, low, high = interval(np.concatenate([[777.0], np.arange(1001.0)]))
    assert (value, low, high) == (777, 25, 975)
