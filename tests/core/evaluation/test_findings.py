"""The report's findings, judged on tables whose answer is known."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from tactile_core.evaluation.findings import (
    findings,
    of_grasps,
    of_reconstruction,
    of_steps,
)
from tactile_core.evaluation.readings import by_choice, per_grasp_reading, per_step_reading
from tactile_core.evaluation.rollouts import cast_rollouts
from tactile_core.evaluation.seen_in_pictures import (
    HALF_CIRCLE,
    in_common,
    other_half,
    told_by_radius,
)
from tactile_core.evaluation.statistics import REPORTS
from tactile_core.evaluation.tables import policy_results
from tactile_core.exploration.world.circle import circle_pixels, middle
from tactile_core.settings import EvaluationSettings, RolloutSettings

RANDOM_STEP = {"last": 60.0, "last_low": 59.0, "last_high": 61.0}
GOOD_STEP = {"last": 80.0, "last_low": 79.0, "last_high": 81.0}


def steps(**other: dict) -> pd.DataFrame:
    every = {"random": RANDOM_STEP} | dict.fromkeys(REPORTS, GOOD_STEP) | other
    return pd.DataFrame(every).T


def grasps(**other: dict) -> pd.DataFrame:
    random = {"last": 90.0, "last_low": 89.0, "last_high": 91.0, "rays": 46.0, "reached": 1.0}
    policy = {**GOOD_STEP, "rays": 14.0, "reached": 1.0}
    every = {"random": random} | dict.fromkeys(REPORTS, policy)
    every["pre_diff_miss"] = {**policy, "last": 82.0}
    return pd.DataFrame(every | other).T


def curve(rise_of_pre_diff_miss: float) -> pd.DataFrame:
    rises = dict.fromkeys(REPORTS, 10.0) | {"pre_diff_miss": rise_of_pre_diff_miss}
    return pd.DataFrame({1: 58.0, 3: {name: 58 + rise for name, rise in rises.items()}})


def no(rows) -> list[str]:
    return [row.finding for row in rows if not row.same]


def test_what_the_report_says_is_found_where_the_numbers_are_the_reports():
    assert no(of_steps(steps(), curve(4.0))) == []
    assert no(of_grasps(steps(), grasps())) == []


@pytest.mark.parametrize(
    ("changed", "lost"),
    [
        ({"random": RANDOM_STEP | {"last": 67.4}}, ["`random` after ten rays (Figure 4)"]),
        ({"diff": GOOD_STEP | {"last": 76.9}}, ["`diff` after ten rays"]),
        (
            {"total": {"last": 61.5, "last_low": 60.5, "last_high": 62.5}},
            ["`total` after ten rays", "`total` is above `random` after ten rays"],
        ),
    ],
)
def test_what_is_otherwise_per_step_is_told(changed, lost):
    assert no(of_steps(steps(**changed), curve(4.0))) == lost


def test_a_policy_without_penalty_that_rises_as_fast_is_told():
    [lost] = no(of_steps(steps(), curve(10.0)))
    assert "rises more slowly" in lost


def test_what_is_otherwise_per_grasp_is_told():
    few = {"last": 89.5, "last_low": 88.5, "last_high": 90.5, "rays": 23.0, "reached": 1.0}
    assert no(of_grasps(steps(), grasps(total=few))) == [
        "`random` is above `total` at ten touches",
        "`total` is nearly the same at ten touches as after ten rays",
        "`random` needs more than three times the rays of `total`",
    ]


@pytest.mark.parametrize(
    ("random", "policy", "said", "same"),
    [(1.0, 1.0, "4.6", True), (0.9, 1.0, "≥ 4.6", True), (1.0, 0.5, "≤ 4.6", False),
     (0.9, 0.5, "≈ 4.6", False)],
)  # fmt: skip
def test_a_ratio_of_rays_is_a_bound_where_not_every_rollout_got_its_touches(
    random, policy, said, same
):
    """Of those that did not, only the rays that they did cast count."""
    of_both = grasps().loc[["random", "total"]].assign(rays=[46.0, 10.0], reached=[random, policy])
    [found] = [row for row in of_grasps(steps(), of_both) if "three times" in row.finding]
    assert (found.ours, found.same) == (said, same)


def test_policies_that_a_run_lacks_have_no_row():
    rows = list(of_steps(steps().drop(["total", "diff"]), curve(4.0)))
    assert not [row for row in rows if "`diff`" in row.finding or "slowly" in row.finding]
    assert list(of_grasps(steps(), grasps().drop("random"))) == []


def test_the_mean_over_unets_is_beside_table_ii():
    table = pd.DataFrame(
        {
            "split": ["eval", "test"] * 2,
            "touches": pd.array([None] * 4, "Int64"),
            "jaccard": [77.0, 77.0, 79.0, 79.0],
        }
    )
    test, eval_and_test = of_reconstruction(table)
    assert (test.ours, test.same, eval_and_test.ours) == ("78.0", True, "+0.0")
    assert not next(of_reconstruction(table.assign(jaccard=70.0))).same


def test_a_disc_is_told_by_the_distance_from_the_middle_and_half_a_picture_is_not():
    rows, columns = np.indices((64, 64)) - middle(64)
    assert told_by_radius((np.hypot(rows, columns).round() < 20).astype(float)) > 0.999
    assert told_by_radius((rows < 0).astype(float)) < 0.1
    assert told_by_radius(np.full((64, 64), 0.3)) == 0


def rollouts_from(angles: np.ndarray) -> pd.DataFrame:
    """Ten rays that start in these directions (radians)."""
    down, across = (circle_pixels(64) - middle(64)).T.astype(float)
    of_pixels = np.arctan2(down, across)
    alpha = [np.abs(np.exp(1j * of_pixels) - np.exp(1j * angle)).argmin() for angle in angles]
    return pd.DataFrame(
        {"policy": "total", "seed": 0, "sample_id": "a", "ray": range(1, 11), "alpha": alpha}
    )


@pytest.mark.parametrize(
    ("width", "common"), [(0, 1), (np.pi / 2, 0.9), (np.pi, HALF_CIRCLE), (2 * np.pi, 0)]
)
def test_rays_have_less_in_common_the_wider_they_are_spread(width, common):
    angles = 1 + width * (np.arange(10) + 0.5) / 10
    assert in_common(rollouts_from(angles), 64)["total"] == pytest.approx(common, abs=0.03)


def test_only_the_first_ten_rays_of_a_rollout_count():
    later = rollouts_from(np.full(10, 4.0)).assign(ray=range(11, 21))
    ten = rollouts_from(np.full(10, 1.0))
    assert in_common(pd.concat([ten, later]), 64)["total"] == pytest.approx(1)


def test_what_touches_on_one_side_tell_of_the_other_is_measured_there_alone(shapes):
    test, asked = shapes["test"], []

    def right_half_alone(felt: np.ndarray) -> np.ndarray:
        asked.append(felt)
        predictions = test.masks.astype(np.float32)
        predictions[..., : middle(64) + 1] = 0  # wrong, where it is not looked at
        return predictions

    knowing = SimpleNamespace(untouched=np.ones((64, 64), np.float32), predict=right_half_alone)
    before, after = other_half(test, knowing)
    assert 0 < before < 50 and after == 100
    [felt] = asked
    assert (felt[..., : middle(64) + 1] > 0).any(axis=(1, 2)).all()
    assert not felt[..., middle(64) + 1 :].any()
    assert (felt.sum(axis=(1, 2)) <= 10).all()


def test_a_run_is_told_in_words_row_by_row(shapes, unet, reconstructor):
    settings = RolloutSettings(references=["random", "even"], ray_limit=60)
    rollouts = cast_rollouts([], shapes["test"], unet, settings)
    read = EvaluationSettings(resamples=50)
    reconstruction = pd.DataFrame(
        {
            "split": ["train", "eval", "test"],
            "touches": pd.array([None] * 3, "Int64"),
            "jaccard": [80.0, 79.0, 78.0],
        }
    )
    table = findings(
        reconstruction,
        policy_results(per_step_reading(rollouts, read), "step", 50, 0),
        policy_results(per_grasp_reading(rollouts, read), "grasp", 50, 0),
        by_choice(rollouts, read),
        shapes["test"],
        reconstructor,
    )
    assert list(table.columns) == ["finding", "report", "ours", "judged", "same"]
    assert set(table["same"]) <= {"yes", "no"}
    assert table["finding"].is_unique and len(table) == 6


def test_nothing_is_said_of_ten_rays_where_a_run_has_fewer(shapes, unet, reconstructor):
    some = RolloutSettings(references=["random"], count=2, ray_limit=60)
    rollouts, read = cast_rollouts([], shapes["test"], unet, some), EvaluationSettings(count=2)
    mix = pd.array([None] * 2, "Int64")
    table = findings(
        pd.DataFrame({"split": ["eval", "test"], "touches": mix, "jaccard": 78.0}),
        policy_results(per_step_reading(rollouts, read), "step", 50, 0),
        policy_results(per_grasp_reading(rollouts, read), "grasp", 50, 0),
        rollouts,
        shapes["test"],
        reconstructor,
    )
    assert len(table) == 4 and not table["finding"].str.contains("ten rays").any()
