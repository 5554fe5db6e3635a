"""A trained U-Net as files."""

import errno
import json

import numpy as np
import pytest
import torch
from safetensors.torch import load, save
from upath import UPath

from tactile_core.dataset.packed import pack_masks
from tactile_core.errors import OutOfReachError, TactileError
from tactile_core.reconstruction.known_shapes import unpack
from tactile_core.reconstruction.trained import load_unet, save_unet, unet_at

FILES = ("model.safetensors", "settings.json", "curve.parquet", "trained_on.parquet")


@pytest.fixture
def stored(unet, tmp_path) -> UPath:
    save_unet(unet, UPath(tmp_path))
    return UPath(tmp_path)


def test_a_stored_unet_is_read_back_as_it_was(unet, stored):
    again = load_unet(stored)
    assert again.version() == unet.version()
    assert again.curve.equals(unet.curve)
    for name in ("resolution", "depth", "channels", "settings", "scores"):
        assert getattr(again, name) == getattr(unet, name)
    touches = torch.zeros(1, 1, 64, 64)
    touches[..., 30, 25] = 1
    assert torch.equal(again.net()(touches), unet.net()(touches))


def test_a_unet_that_cannot_be_read_now_is_not_taken_for_none(unet, stored, monkeypatch):
    """A store that is busy for a moment must not make it be trained anew."""

    def busy(path):
        raise OSError(errno.EBUSY, "Please reduce your request rate")

    assert unet_at(stored / "nothing") is None
    with monkeypatch.context() as patch:
        patch.setattr(type(stored), "read_bytes", busy)
        with pytest.raises(OutOfReachError, match=r"settings.json cannot be read .*reduce your"):
            unet_at(stored)
    assert unet_at(stored).version() == unet.version()


def test_the_known_shapes_are_stored_with_the_net_and_can_be_forgotten(
    knowing_unet, shapes, tmp_path
):
    masks = shapes["train"].masks
    save_unet(knowing_unet, UPath(tmp_path))
    again = load_unet(UPath(tmp_path))
    assert again.version() == knowing_unet.version()
    np.testing.assert_array_equal(unpack(again.known, 64), masks)
    less = again.forgetting(pack_masks(masks[:5]))
    np.testing.assert_array_equal(unpack(less.known, 64), masks[5:])
    assert less.version() != again.version()


def test_equal_unets_are_equal_files(unet, stored, tmp_path):
    save_unet(load_unet(stored), UPath(tmp_path) / "again")
    for name in FILES:
        assert (stored / name).read_bytes() == (stored / "again" / name).read_bytes()


def test_an_object_store_holds_a_unet_as_a_folder_does(unet):
    directory = UPath("memory://unets/one")
    save_unet(unet, directory)
    assert load_unet(directory).version() == unet.version()


@pytest.mark.parametrize("name", FILES)
def test_a_missing_file_is_told_in_one_line(stored, name):
    (stored / name).unlink()
    with pytest.raises(TactileError, match=r"materialise") as refused:
        load_unet(stored)
    assert str(stored) in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("damage", [lambda data: data[: len(data) // 2], lambda data: b"", None])
def test_a_damaged_file_is_told_in_one_line(stored, name, damage):
    whole = (stored / name).read_bytes()
    (stored / name).write_bytes(damage(whole) if damage else b"{}")
    with pytest.raises(TactileError, match=r"materialise") as refused:
        load_unet(stored)
    assert str(stored) in str(refused.value)


def test_weights_and_settings_of_two_trainings_are_told_apart(stored):
    """As a store that was interrupted between the two files leaves them."""
    weights = load((stored / "model.safetensors").read_bytes())
    weights["head.bias"] += 1
    (stored / "model.safetensors").write_bytes(save(weights))
    with pytest.raises(TactileError, match="files are of two trainings"):
        load_unet(stored)


def test_settings_of_another_resolution_are_told_apart(stored):
    about = json.loads((stored / "settings.json").read_bytes())
    (stored / "settings.json").write_text(json.dumps({**about, "resolution": 128}))
    with pytest.raises(TactileError, match="of two trainings"):
        load_unet(stored)


@pytest.mark.parametrize("field", ["resolution", "settings", "scores", "version"])
@pytest.mark.parametrize("value", [None, "a word", [1]])
def test_a_description_with_something_else_in_it_is_told_in_one_line(stored, field, value):
    description = json.loads((stored / "settings.json").read_bytes())
    (stored / "settings.json").write_text(json.dumps({**description, field: value}))
    with pytest.raises(TactileError, match="materialise unet again") as refused:
        load_unet(stored)
    assert "\n" not in str(refused.value)


def test_a_unet_remembers_what_it_was_trained_on(unet, stored, shapes):
    seen = load_unet(stored).trained_on
    assert seen.equals(unet.trained_on)
    for split in ("train", "eval"):
        of_split = seen[seen["split"] == split]
        assert set(of_split["model_id"]) == set(shapes[split].model_ids)
        assert set(of_split["geometry"]) == set(shapes[split].geometries)
    assert not set(seen["geometry"]) & set(shapes["test"].geometries)
