"""Policies as files: what is stored, and what is refused when it is read."""

import dataclasses
import json

import pytest
from upath import UPath

from tactile_core.errors import TactileError
from tactile_core.exploration.learning.approaches import APPROACHES, find_approach
from tactile_core.exploration.policies.store import load_policies
from tactile_core.parquet import read_table
from tests.core.exploration.quick import QUICK

OF_BOTH = {"policy.safetensors", "curve.parquet", "trained_on.parquet", "settings.json"}
FILES = {"ppo": OF_BOTH | {"policy.zip"}, "gains": OF_BOTH}


@pytest.mark.parametrize("approach", ["diff", "gain"])
def test_a_policy_is_stored_with_its_curve_and_settings(train, unet, tmp_path, approach):
    version = train(approach, seed=3)
    stored = tmp_path / "policy"
    learner = find_approach(approach).learner
    assert {path.name for path in stored.iterdir()} == FILES[learner]
    about = json.loads((stored / "settings.json").read_text())
    assert (about["approach"], about["seed"], about["resolution"]) == (approach, 3, 64)
    assert (about["version"], about["unet"]) == (version, unet.version())
    assert about["settings"]["steps_per_stage"] == 512
    curve = read_table(stored / "curve.parquet")
    assert {"stage", "steps", "reward", "jaccard", "touches"} <= set(curve.columns)
    assert curve["steps"].is_monotonic_increasing


def test_a_second_ray_scorer_has_a_recall_of_its_own(train, unet, tmp_path, monkeypatch):
    own = dataclasses.replace(find_approach("gain"), name="gain_too")
    monkeypatch.setitem(APPROACHES, "gain_too", own)
    for approach in ("gain", "gain_too"):
        train(approach, name=approach)
    names = [
        policy.name
        for approach in ("gain", "gain_too")
        for policy in load_policies([UPath(tmp_path) / approach], unet.version(), 64)
    ]
    assert names == ["gain", "recall", "gain_too", "recall_gain_too"]


@pytest.mark.parametrize("approach", ["diff", "gain"])
def test_a_policy_of_another_resolution_is_refused(train, unet, tmp_path, approach):
    train(approach)
    with pytest.raises(TactileError, match="trained at resolution 64, the U-Net is at 128"):
        load_policies([UPath(tmp_path) / "policy"], unet.version(), 128)


def test_a_policy_of_another_unet_is_refused(train, tmp_path):
    train("diff")
    with pytest.raises(TactileError, match="trained with another U-Net"):
        load_policies([UPath(tmp_path) / "policy"], "another", 64)


@pytest.mark.parametrize("approach", ["diff", "gain"])
def test_missing_and_damaged_policies_are_told_in_one_line(train, unet, tmp_path, approach):
    train(approach)
    directory = UPath(tmp_path) / "policy"
    for name in ("policy.safetensors", "settings.json"):
        whole = (directory / name).read_bytes()
        for damaged in (b"", b"{}", b"[1]", b"null", whole[: len(whole) // 2], None):
            (directory / name).unlink()
            if damaged is not None:
                (directory / name).write_bytes(damaged)
            with pytest.raises(TactileError, match="materialise policies") as refused:
                load_policies([directory], unet.version(), 64)
            assert str(directory) in str(refused.value)
            assert "\n" not in str(refused.value)
            (directory / name).write_bytes(whole)
    load_policies([directory], unet.version(), 64)


def test_weights_under_the_settings_of_another_training_are_refused(train, unet, tmp_path):
    train("total", "one")
    train("total", "other", seed=1)
    stored = tmp_path / "other" / "policy.safetensors"
    (tmp_path / "one" / "policy.safetensors").write_bytes(stored.read_bytes())
    with pytest.raises(TactileError, match="weights and settings are of two trainings"):
        load_policies([UPath(tmp_path) / "one"], unet.version(), 64)


def test_one_flipped_bit_in_the_weights_is_found(train, unet, tmp_path):
    train("gain")
    file = tmp_path / "policy" / "policy.safetensors"
    flipped = bytearray(file.read_bytes())
    flipped[-1000] ^= 1
    file.write_bytes(flipped)
    with pytest.raises(TactileError, match="materialise policies again"):
        load_policies([UPath(tmp_path) / "policy"], unet.version(), 64)


@pytest.mark.parametrize("value", [None, [1], {"a": 1}])
def test_a_description_with_something_else_in_it_is_told_in_one_line(train, unet, tmp_path, value):
    train("diff")
    directory = UPath(tmp_path) / "policy"
    whole = json.loads((directory / "settings.json").read_bytes())
    for field in whole:
        for text in (
            {**whole, field: value},
            {name: whole[name] for name in whole if name != field},
        ):
            (directory / "settings.json").write_text(json.dumps(text))
            with pytest.raises(TactileError, match="materialise policies again") as refused:
                load_policies([directory], unet.version(), 64)
            assert "\n" not in str(refused.value) and len(str(refused.value)) < 500


@pytest.mark.parametrize(
    "altered",
    [{"approach": "gain"}, {"seed": 1}, {"settings": QUICK.model_dump() | {"discount": 0.9}}],
)
def test_a_description_that_was_altered_is_found(train, unet, tmp_path, altered):
    train("diff")
    directory = UPath(tmp_path) / "policy"
    whole = json.loads((directory / "settings.json").read_bytes())
    (directory / "settings.json").write_text(json.dumps(whole | altered))
    with pytest.raises(TactileError, match=r"settings\.json was altered"):
        load_policies([directory], unet.version(), 64)
