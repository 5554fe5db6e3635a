"""Practice: the rays of a first policy, for the final U-Net to learn from."""

import dataclasses

import numpy as np
import pytest

from tactile_core.dataset.packed import pack_masks
from tactile_core.errors import TactileError
from tactile_core.exploration.policies.references import find_reference
from tactile_core.exploration.practice.practice import Practice, practise, record
from tactile_core.exploration.practice.ray_touches import practised, rays_and_outlines
from tactile_core.exploration.world.rays import RAYS, cast_rays
from tactile_core.parquet import read_table, table_hash, write_table
from tactile_core.reconstruction import training
from tactile_core.reconstruction.inference import Reconstructor
from tactile_core.reconstruction.training import train_unet
from tactile_core.settings import NetSettings, PracticeSettings, UNetSettings

QUICK = PracticeSettings(
    learning_rate=1e-2, batch_size=8, depth=2, channels=2, epochs=2, free_space=True,
    gain_iterations=2, gain_states=4, gain_tries=2, gain_updates=1,
)  # fmt: skip


@pytest.fixture
def reconstructor_48(small_shapes, tmp_path):
    net_settings = UNetSettings(**QUICK.model_dump(include=set(NetSettings.model_fields)))
    unet = train_unet(small_shapes["train"], small_shapes["eval"], net_settings, work=tmp_path)
    return Reconstructor(unet, precision="float32")


def test_practice_records_what_each_ray_touched_and_repeats_itself(small_shapes, tmp_path):
    train, eval_shapes = small_shapes["train"], small_shapes["eval"]
    table = practise(train, eval_shapes, QUICK, work=tmp_path / "one")
    write_table(table, tmp_path / "practice_rays.parquet")
    sequences = practised(read_table(tmp_path / "practice_rays.parquet"), train)
    rays, touches = sequences
    assert rays.shape == touches.shape == (len(train), 6, RAYS, 2)
    owners = np.repeat(np.arange(len(train)), 6 * RAYS)
    met = cast_rays(train.masks, rays.reshape(-1, 2), owners)
    np.testing.assert_array_equal(met, touches.reshape(-1, 2))
    again = practise(train, eval_shapes, QUICK, work=tmp_path / "other")
    assert table_hash(again) == table_hash(table)
    said: list[str] = []
    kept = practise(train, eval_shapes, QUICK, work=tmp_path, previous=table, progress=said.append)
    assert kept is table and said == ["practice: kept, as nothing that it depends on has changed"]
    felt = rays_and_outlines(train, 0, free_space=True, practice=sequences).draw(
        np.random.default_rng(0), np.zeros(900, int)
    )
    assert 550 < (felt == -1).any(axis=(1, 2)).sum() < 650  # two thirds are of rays


def test_practice_on_other_samples_is_refused(small_shapes, tmp_path):
    train = small_shapes["train"]
    table = practise(train, small_shapes["eval"], QUICK, work=tmp_path)
    for other in (small_shapes["test"], train.select(np.arange(len(train) - 1))):
        with pytest.raises(TactileError, match="recorded on other train samples"):
            practised(table, other)
    mirrored = dataclasses.replace(train, packed=pack_masks(train.masks[:, :, ::-1]))
    larger = table.assign(rays=[2 * rays for rays in table["rays"]])
    for some, other in ((table, mirrored), (larger, train)):
        with pytest.raises(TactileError, match="recorded on other train samples"):
            practised(some, other)
    turned = train.select(np.arange(len(train))[::-1])
    np.testing.assert_array_equal(practised(table, turned).rays, practised(table, train).rays[::-1])


def test_practice_killed_after_the_first_unet_trains_none_again(
    small_shapes, tmp_path, monkeypatch
):
    splits = small_shapes["train"], small_shapes["eval"]
    whole = practise(*splits, QUICK, work=tmp_path / "whole")

    def cut(message):
        if "practice: gain" in message:
            raise KeyboardInterrupt

    for name in ("cut", "changed"):
        with pytest.raises(KeyboardInterrupt):
            practise(*splits, QUICK, work=tmp_path / name, progress=cut)
    monkeypatch.delattr(training, "begin_training")
    resumed = practise(*splits, QUICK, work=tmp_path / "cut")
    assert table_hash(resumed) == table_hash(whole)
    # What was practised is kept until it has been stored.
    assert table_hash(practise(*splits, QUICK, work=tmp_path / "cut")) == table_hash(whole)
    assert [place.name for place in (tmp_path / "cut").iterdir()] == ["finished.parquet"]
    assert practise(*splits, QUICK, work=tmp_path / "cut", previous=whole) is whole
    assert not (tmp_path / "cut").exists()
    with pytest.raises(NameError):
        practise(*splits, QUICK.model_copy(update={"seed": 1}), work=tmp_path / "changed")
    for weights in (tmp_path / "changed").rglob("model.safetensors"):
        weights.write_bytes(b"damaged")
    with pytest.raises(NameError):
        practise(*splits, QUICK, work=tmp_path / "changed")


def test_strays_are_as_many_as_asked(small_shapes, reconstructor_48):
    train = small_shapes["train"]
    even = find_reference("even")
    said: list[str] = []
    straight, strayed = (
        record(
            Practice(even, strays), train, reconstructor_48, np.random.default_rng(0), "even",
            said.append,
        )[0]
        for strays in (0, 0.25)
    )  # fmt: skip
    assert said[-1] == f"even: {len(train)} of {len(train)} samples"
    share = (straight != strayed).any(axis=-1).mean()
    assert 0.15 < share < 0.35
