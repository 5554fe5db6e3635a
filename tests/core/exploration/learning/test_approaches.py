"""The training approaches are those of the report (section VI.B)."""

import numpy as np
import pytest

from tactile_core.errors import TactileError
from tactile_core.exploration.learning.approach import Approach
from tactile_core.exploration.learning.approaches import APPROACHES, find_approach
from tactile_core.exploration.world.rewards import Stage, total
from tactile_core.exploration.world.state import Cast

# A ray that hits, one that misses and one that repeats.
CAST = Cast(
    touches=np.array([[30, 30], [-1, -1], [31, 31]], np.int16),
    missed=np.array([False, True, False]),
    repeated=np.array([False, False, True]),
    jaccard_before=np.array([50, 60, 70], np.float32),
    jaccard=np.array([55, 60, 70], np.float32),
)


@pytest.mark.parametrize(
    ("name", "stages"),
    [
        ("diff", [([5, -10, -10], "rays")]),
        ("total", [([55, -10, -10], "rays")]),
        ("total_miss", [([55, 60, 70], "touches"), ([55, -10, -10], "rays")]),
        ("pre_diff_miss", [([5, 0, 0], "touches")]),
    ],
)
def test_the_report_s_approaches_reward_and_end_as_it_says(name, stages):
    approach = find_approach(name)
    assert approach.learner == "ppo"
    assert [(stage.reward(CAST).tolist(), stage.ends) for stage in approach.stages] == stages


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({}, "PPO trains stages, at least one"),
        ({"stages": Stage(total)}, "its stages are a tuple of Stage"),
        ({"stages": (total,)}, "its stages are a tuple of Stage"),
        ({"learner": "gain"}, "learner='gain' is unknown: choose ppo, gains, sequence"),
        ({"learner": "gains", "stages": (Stage(total),)}, "other learners none"),
    ],
)
def test_an_approach_that_cannot_be_trained_is_refused_where_it_is_written(given, said):
    with pytest.raises(TactileError, match=f"approach 'bold': .*{said}"):
        Approach("bold", "Any.", **given)


def test_a_stage_that_nothing_ends_is_refused():
    with pytest.raises(TactileError, match="ends='ray' is unknown: choose rays or touches"):
        Stage(total, ends="ray")
    with pytest.raises(TactileError, match="reward is a function"):
        Stage(-1.0)


def test_an_approach_is_found_by_its_name():
    names = ["diff", "total", "total_miss", "pre_diff_miss", "gain"]
    assert [find_approach(name).name for name in names] == names == list(APPROACHES)[:5]
    assert [find_approach(name).name for name in APPROACHES] == list(APPROACHES)


def test_an_unknown_approach_is_refused_with_the_known_ones():
    with pytest.raises(TactileError) as refused:
        find_approach("totl")
    for word in ("'totl'", *APPROACHES, "approaches.py"):
        assert word in str(refused.value)
    assert "\n" not in str(refused.value)
