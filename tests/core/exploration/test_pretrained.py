"""The weights that the package ships: whole, known in their making, and there where no run is."""

import shutil

import numpy as np
import pytest
from upath import UPath

from tactile_core.dataset.rendering.pictures import decode_masks
from tactile_core.errors import TactileError
from tactile_core.evaluation.shipping import POLICIES, RULES, ship
from tactile_core.exploration.at_hand import ROTATED_SPLITS, UNET, at_hand
from tactile_core.exploration.environments import make_env
from tactile_core.exploration.pretrained import FOLDER, PROVENANCE, pretrained, provenance
from tactile_core.parquet import read_table, write_table
from tactile_core.reconstruction.trained import load_unet, save_unet


@pytest.fixture
def empty_home(tmp_path, monkeypatch):
    monkeypatch.setenv("TACTILE_HOME", str(tmp_path / "home"))
    monkeypatch.delenv("TACTILE_STORE", raising=False)
    return tmp_path / "home"


@pytest.fixture
def few(tmp_path):
    """The shipped weights with no more than three shapes to test on."""
    folder = shutil.copytree(FOLDER, tmp_path / "few")
    splits = read_table(folder / ROTATED_SPLITS)
    test = splits[splits["split"] == "test"].head(3)
    others = splits[splits["split"] == "train"].head(3)
    write_table(splits.loc[[*test.index, *others.index]], folder / ROTATED_SPLITS)
    return folder


def test_they_are_small_and_say_where_they_come_from():
    known = provenance()
    assert {"profile", "commit", "started"} <= known.made.keys()
    assert sum(file.stat().st_size for file in FOLDER.rglob("*") if file.is_file()) < 6_000_000
    assert {"gain", "recall", "sequence", *RULES} == known.jaccard.keys()
    assert all(len(curve) == 10 and min(curve) > 0 for curve in known.jaccard.values())
    assert known.jaccard["recall"][-1] > known.jaccard["random"][-1]


def test_a_changed_or_missing_file_is_named(tmp_path):
    for number, file in enumerate(sorted(provenance().sha256)):
        folder = shutil.copytree(FOLDER, tmp_path / str(number))
        assert pretrained(folder) == UPath(folder)
        pretrained.cache_clear()
        data = bytearray((folder / file).read_bytes())
        data[len(data) // 2] ^= 1
        (folder / file).write_bytes(data)
        with pytest.raises(TactileError, match=rf"{file} was altered.*install .* again"):
            pretrained(folder)
        (folder / file).unlink()
        with pytest.raises(TactileError, match=f"{file} cannot be read"):
            pretrained(folder)
    (folder / PROVENANCE).write_text("{}")
    with pytest.raises(TactileError, match="is missing or damaged"):
        pretrained(folder)


def test_what_one_run_stored_is_shipped_as_it_is_and_measured(few, tmp_path):
    known = ship(UPath(few), tmp_path / "shipped", {"profile": "some"})
    assert known == provenance(tmp_path / "shipped")
    assert pretrained(tmp_path / "shipped")
    for name in ("unet/model.safetensors", *(f"policies/{p}/policy.safetensors" for p in POLICIES)):
        assert (tmp_path / "shipped" / name).read_bytes() == (FOLDER / name).read_bytes()


def test_what_was_trained_on_its_test_shapes_or_with_another_unet_is_not_shipped(
    few, tmp_path, unet
):
    splits = read_table(few / ROTATED_SPLITS)
    write_table(splits.assign(split="test"), few / ROTATED_SPLITS)
    with pytest.raises(TactileError, match="were trained on by"):
        ship(UPath(few), tmp_path / "shipped", {})
    save_unet(unet, UPath(few, "unet"))
    with pytest.raises(TactileError, match="another U-Net"):
        ship(UPath(few), tmp_path / "shipped", {})
    assert not (tmp_path / "shipped" / PROVENANCE).exists()


def test_without_a_run_the_environment_is_made_of_them(empty_home):
    splits = read_table(FOLDER / ROTATED_SPLITS)
    for split in ("test", "train"):
        env = make_env(split=split)
        masks = decode_masks(splits.loc[splits["split"] == split, "mask"])
        np.testing.assert_array_equal(env.masks, masks)
        assert env.reconstructor.version == load_unet(UPath(FOLDER, "unet")).version()


def test_what_a_run_stored_comes_first_once_it_is_complete(empty_home, unet):
    artifacts = UPath(empty_home, "artifacts")
    save_unet(unet, artifacts / "unet")
    assert at_hand() == UPath(FOLDER)
    assert at_hand(UNET) == artifacts
    shutil.copy(FOLDER / ROTATED_SPLITS, artifacts / ROTATED_SPLITS)
    assert at_hand() == artifacts
