"""What a training leaves behind: checkpoints to go on from, curves, and what is kept when done."""

import numpy as np
import pandas as pd
import pytest
import torch
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from tactile_core import progress
from tactile_core.exploration.learning import gain_learner, ppo
from tactile_core.parquet import read_table
from tests.core.exploration.quick import QUICK


@pytest.fixture(autouse=True)
def talkative(monkeypatch):
    """Trainings say how far they are at every turn: here they are broken off by what they say."""
    monkeypatch.setattr(progress, "SECONDS_BETWEEN_WORDS", 0)


class PowerCutError(Exception):
    """Ends a training from outside."""


@pytest.mark.parametrize(
    ("approach", "report"),
    [("diff", 1), ("diff", 2), ("total_miss", 3), ("total_miss", 4), ("gain", 5)],
)
def test_a_training_killed_and_started_again_ends_with_the_same_weights(
    train, tmp_path, monkeypatch, approach, report
):
    """Killed before the first checkpoint, after it, and in the second stage."""
    monkeypatch.setattr(ppo, "RAYS_PER_CHECKPOINT", 256)
    monkeypatch.setattr(gain_learner, "ITERATIONS_PER_CHECKPOINT", 2)
    said = []

    def cut(message):
        said.append(message)
        if len(said) == report:
            raise PowerCutError

    whole = train(approach, "whole")
    with pytest.raises(PowerCutError):
        train(approach, "cut", progress=cut)
    resumed = []
    np.random.seed(99)  # as another process would have it
    torch.manual_seed(99)
    assert train(approach, "cut", progress=resumed.append) == whole
    assert any("resuming" in message for message in resumed) == (report > 1)
    curves = [read_table(tmp_path / name / "curve.parquet") for name in ("whole", "cut")]
    pd.testing.assert_frame_equal(*curves)


def test_a_checkpoint_of_other_settings_is_not_taken_up(train, monkeypatch):
    monkeypatch.setattr(ppo, "RAYS_PER_CHECKPOINT", 256)

    def cut(message):
        if "512/512" in message:
            raise PowerCutError

    with pytest.raises(PowerCutError):
        train("diff", progress=cut)
    said = []
    train("diff", settings=QUICK.model_copy(update={"entropy": 0.1}), progress=said.append)
    assert not any("resuming" in message for message in said)


def test_a_finished_training_is_kept_and_one_that_differs_in_anything_is_not(
    train, shapes, unet, tmp_path
):
    def said(**options) -> bool:
        """Whether the policy was kept."""
        messages = []
        train("total", progress=messages.append, **options)
        return any("kept" in message for message in messages)

    assert not said()
    assert said()
    assert said(settings=QUICK.model_copy(update={"seeds": [0, 1], "gain_tries": 3}))
    assert not said(settings=QUICK.model_copy(update={"entropy": 0.02}))
    assert not said(seed=1)
    assert said(seed=1)
    (tmp_path / "policy" / "policy.safetensors").write_bytes(b"damaged")
    assert not said(seed=1)


@pytest.mark.parametrize("approach", ["diff", "gain"])
def test_a_finished_training_leaves_tensorboard_curves_and_no_checkpoint(
    train, tmp_path, monkeypatch, approach
):
    monkeypatch.setattr(ppo, "RAYS_PER_CHECKPOINT", 256)
    monkeypatch.setattr(gain_learner, "ITERATIONS_PER_CHECKPOINT", 2)
    train(approach)
    assert not list((tmp_path / "work").rglob("*.pt"))
    events = EventAccumulator(str(tmp_path / "work" / "policy" / "tensorboard")).Reload()
    kind = {"diff": "episode", "gain": "gain"}[approach]
    assert {f"{kind}/reward", f"{kind}/jaccard"} <= set(events.Tags()["scalars"])


@pytest.mark.parametrize("approach", ["diff", "gain"])
def test_curves_of_an_earlier_training_are_gone_and_those_of_a_resumed_one_stay(
    train, tmp_path, monkeypatch, approach
):
    monkeypatch.setattr(ppo, "RAYS_PER_CHECKPOINT", 256)
    monkeypatch.setattr(gain_learner, "ITERATIONS_PER_CHECKPOINT", 2)
    folder = tmp_path / "work" / "policy" / "tensorboard"

    def files() -> set[str]:
        return {path.name for path in folder.iterdir()}

    train(approach)
    first = files()

    def cut(message):
        if "5/6" in message or "512/512" in message:
            raise PowerCutError

    with pytest.raises(PowerCutError):
        train(approach, seed=1, progress=cut)
    interrupted = files()
    assert not first & interrupted
    train(approach, seed=1)
    assert interrupted < files()
