"""The report's rewards (section VI.B)."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactile_core.exploration.world.rewards import Penalised, diff, total
from tactile_core.exploration.world.state import Cast

jaccards = st.lists(st.floats(0, 100, width=32), min_size=1, max_size=12)


def casts(jaccard: list[float], missed=False, repeated=False) -> list[Cast]:
    """The rays of one exploration whose Jaccard index goes as given."""
    before = [0.0, *jaccard[:-1]]
    return [
        Cast(
            touches=np.zeros((1, 2), np.int16),
            missed=np.array([missed]),
            repeated=np.array([repeated]),
            jaccard_before=np.array([past], np.float32),
            jaccard=np.array([now], np.float32),
        )
        for past, now in zip(before, jaccard, strict=True)
    ]


@given(jaccards)
def test_diff_rewards_add_up_to_the_final_jaccard_index(jaccard):
    assert sum(diff(cast)[0] for cast in casts(jaccard)) == pytest.approx(jaccard[-1], abs=1e-3)


@given(jaccards)
def test_total_rewards_the_jaccard_index_itself(jaccard):
    assert [total(cast)[0] for cast in casts(jaccard)] == jaccard


@given(jaccards, st.sampled_from([diff, total]), st.booleans(), st.booleans())
def test_a_penalty_of_ten_replaces_the_reward_of_a_miss_or_a_repeat(
    jaccard, reward, missed, repeated
):
    for cast in casts(jaccard, missed, repeated):
        expected = -10 if missed or repeated else reward(cast)[0]
        assert Penalised(reward)(cast)[0] == expected
