"""The short form of `python -m tests.fuzz`, at one seed."""

import os

os.environ.setdefault("TACTILE_PROFILE", "smoke")

import pytest

from tests import fuzz

EACH = 25


def test_broken_input_at_any_door_ends_in_a_result_or_a_sentence(tmp_path):
    outcomes = [fuzz.fuzzed(door, EACH, seed=0) for door in fuzz.doors(tmp_path)]
    assert len(outcomes) > 20
    assert not [fault for outcome in outcomes for fault in outcome.faults]
    assert sum(outcome.results + outcome.sentences for outcome in outcomes) == EACH * len(outcomes)
    for outcome in outcomes:
        # A door that lets everything in, or nothing, was not tried.
        assert outcome.sentences > 0 or outcome.door == "stored: checkpoint", outcome.door


def test_a_door_that_fails_otherwise_is_told():
    def enter(data: bytes) -> None:
        raise KeyError("raw")

    outcome = fuzz.fuzzed(fuzz.Door("open", [b"abc"], enter), 3, seed=0)
    assert len(outcome.faults) == 3 and "KeyError" in outcome.faults[0]


@pytest.mark.parametrize("data", [b"", b"abc"])
def test_damage_is_the_same_for_the_same_seed(data):
    import numpy as np

    made = [fuzz.damaged(data, np.random.default_rng(seed)) for seed in (1, 1, 2, 3, 4)]
    assert made[0] == made[1] and len(set(made)) > 1
