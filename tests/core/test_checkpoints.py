"""Checkpoints: what a killed work goes on from."""

import errno

import numpy as np
import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from upath import UPath

from tactile_core.checkpoints import load_checkpoint, save_checkpoint
from tactile_core.errors import OutOfReachError

STATE = {
    "weights": {"layer": torch.arange(6.0).reshape(2, 3)},
    "rng": np.random.default_rng(0).bit_generator.state,
    "curve": [{"loss": 0.5}],
    "array": np.arange(3),
}


@pytest.fixture
def stored(tmp_path):
    save_checkpoint(tmp_path / "checkpoint.pt", "key", STATE)
    return tmp_path / "checkpoint.pt"


def equals_state(state) -> bool:
    return (
        torch.equal(state["weights"]["layer"], STATE["weights"]["layer"])
        and np.array_equal(state["array"], STATE["array"])
        and (state["rng"], state["curve"]) == (STATE["rng"], STATE["curve"])
    )


def test_a_checkpoint_is_read_back_as_it_was(stored):
    assert equals_state(load_checkpoint(stored, "key"))


def test_a_checkpoint_of_other_inputs_is_left_alone(stored):
    assert load_checkpoint(stored, "another key") is None
    assert equals_state(load_checkpoint(stored, "key"))


def test_where_nothing_was_saved_there_is_nothing(tmp_path):
    assert load_checkpoint(tmp_path / "checkpoint.pt", "key") is None


def test_a_checkpoint_that_cannot_be_read_now_is_not_taken_for_none(stored, monkeypatch):
    """A store that is busy for a moment must not make hours of work start over."""

    def busy(path):
        raise OSError(errno.EBUSY, "Please reduce your request rate")

    with monkeypatch.context() as patch:
        patch.setattr(type(UPath(stored)), "read_bytes", busy)
        with pytest.raises(OutOfReachError, match=r"checkpoint.pt cannot be read .*reduce your"):
            load_checkpoint(stored, "key")
    assert equals_state(load_checkpoint(stored, "key"))


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(share=st.floats(0, 1, exclude_max=True))
def test_a_checkpoint_cut_short_is_the_same_as_none(stored, share):
    whole = stored.read_bytes()
    broken = stored.with_name("broken.pt")
    broken.write_bytes(whole[: int(share * len(whole))])
    assert load_checkpoint(broken, "key") is None


@given(data=st.binary(max_size=200))
@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_file_that_is_no_checkpoint_is_the_same_as_none(tmp_path, data):
    (tmp_path / "other.pt").write_bytes(data)
    assert load_checkpoint(tmp_path / "other.pt", "key") is None
