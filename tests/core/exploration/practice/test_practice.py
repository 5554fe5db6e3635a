"""Practice: the rays of a first policy, for the final U-Net to learn from."""

import numpy as np
import pytest

from tactile_core.exploration.policies.references import find_reference
from tactile_core.exploration.practice import practice
from tactile_core.exploration.practice.practice import Practice, practise, record
from tactile_core.exploration.practice.ray_touches import rays_and_outlines
from tactile_core.exploration.world.rays import RAYS, cast_rays
from tactile_core.reconstruction.inference import Reconstructor
from tactile_core.reconstruction.training import train_unet
from tactile_core.settings import PolicySettings, UNetSettings

QUICK = UNetSettings(
    learning_rate=1e-2, batch_size=8, depth=2, channels=2, epochs=2, free_space=True, practice=True
)


@pytest.fixture
def quick_gains(monkeypatch):
    few = PolicySettings(gain_iterations=2, gain_states=4, gain_tries=2, gain_updates=1)
    monkeypatch.setattr(practice, "PolicySettings", lambda: few)


@pytest.fixture
def reconstructor_48(small_shapes, tmp_path):
    unet = train_unet(small_shapes["train"], small_shapes["eval"], QUICK, work=tmp_path)
    return Reconstructor(unet, precision="float32")


def test_practice_records_what_each_ray_touched_and_repeats_itself(
    small_shapes, quick_gains, tmp_path
):
    train, evaluation = small_shapes["train"], small_shapes["eval"]
    rays, touches = practise(train, evaluation, QUICK, work=tmp_path / "one")
    assert rays.shape == touches.shape == (len(train), 6, RAYS, 2)
    owners = np.repeat(np.arange(len(train)), 6 * RAYS)
    met = cast_rays(train.masks, rays.reshape(-1, 2), owners)
    np.testing.assert_array_equal(met, touches.reshape(-1, 2))
    again = practise(train, evaluation, QUICK, work=tmp_path / "other")
    np.testing.assert_array_equal(again.rays, rays)
    felt = rays_and_outlines(train, 0, free_space=True, practice=again)(
        np.random.default_rng(0), np.zeros(900, int)
    )
    assert 550 < (felt == -1).any(axis=(1, 2)).sum() < 650  # two thirds are of rays


def test_finished_practice_is_not_done_again(small_shapes, quick_gains, tmp_path, monkeypatch):
    splits = small_shapes["train"], small_shapes["eval"]
    first = practise(*splits, QUICK, work=tmp_path)
    monkeypatch.delattr(practice, "train_unet")
    np.testing.assert_array_equal(practise(*splits, QUICK, work=tmp_path).rays, first.rays)
    with pytest.raises(NameError):
        practise(*splits, QUICK.model_copy(update={"seed": 1}), work=tmp_path)


def test_practice_killed_after_the_first_unet_trains_none_again(
    small_shapes, quick_gains, tmp_path, monkeypatch
):
    splits = small_shapes["train"], small_shapes["eval"]
    whole = practise(*splits, QUICK, work=tmp_path / "whole")

    def cut(message):
        if "practice: gain" in message:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        practise(*splits, QUICK, work=tmp_path / "cut", progress=cut)
    monkeypatch.delattr(practice, "train_unet")
    resumed = practise(*splits, QUICK, work=tmp_path / "cut")
    np.testing.assert_array_equal(resumed.rays, whole.rays)


def test_strays_are_as_many_as_asked(small_shapes, reconstructor_48):
    train = small_shapes["train"]
    even = find_reference("even")
    straight, _ = record(Practice(even, 0), train, reconstructor_48, np.random.default_rng(0))
    strayed, _ = record(Practice(even, 0.25), train, reconstructor_48, np.random.default_rng(0))
    share = (straight != strayed).any(axis=-1).mean()
    assert 0.15 < share < 0.35
