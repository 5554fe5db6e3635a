"""U-Nets of several seeds, stored as one."""

import shutil
from dataclasses import replace

import pytest
from upath import UPath

from tactile_core.errors import TactileError
from tactile_core.reconstruction.trained import load_unet, save_unet
from tactile_core.reconstruction.unets import (
    INDEX,
    first_of,
    load_unets,
    save_unets,
    settings_of_each,
    unet_of,
    version_of,
)
from tactile_core.settings import UNetSettings


@pytest.fixture
def unets(unet):
    """Three that differ in their weights, the first of seed 4."""
    return {
        seed: replace(
            unet, weights={name: factor * values for name, values in unet.weights.items()}
        )
        for factor, seed in enumerate((4, 0, 7), start=1)
    }


def versions(unets) -> dict[int, str]:
    return {seed: unet.version() for seed, unet in unets.items()}


@pytest.mark.parametrize("place", ["{tmp_path}/unet", "memory://unets/several"])
def test_unets_of_several_seeds_are_read_back_in_their_order(unets, tmp_path, place):
    directory = UPath(place.format(tmp_path=tmp_path))
    save_unets(unets, directory)
    again = load_unets(directory)
    assert list(versions(again).items()) == list(versions(unets).items())
    assert load_unet(directory).version() == first_of(unets).version() == unets[4].version()


def test_a_unet_that_was_stored_alone_is_the_only_one(unet, tmp_path):
    save_unet(unet, UPath(tmp_path))
    assert versions(load_unets(UPath(tmp_path))) == {0: unet.version()}


def test_folders_of_seeds_that_are_no_longer_trained_go(unets, tmp_path):
    directory = UPath(tmp_path)
    save_unets(unets, directory)
    fewer = {4: unets[4], 7: unets[7]}
    save_unets(fewer, directory)
    assert versions(load_unets(directory)) == versions(fewer)
    assert [folder.name for folder in directory.glob("seed-*")] == ["seed-7"]


def test_one_of_another_training_is_told(unets, tmp_path):
    directory = UPath(tmp_path)
    save_unets(unets, directory)
    save_unet(unets[0], directory / "seed-7")
    with pytest.raises(TactileError, match=r"seed-7 is of another training .* unet again"):
        load_unets(directory)
    save_unet(unets[0], directory)  # as where a run was killed after the first had been written
    with pytest.raises(TactileError, match=r"another training .* unet again"):
        load_unets(directory)


@pytest.mark.parametrize("where", [INDEX, "seed-7/settings.json", "seed-7/model.safetensors"])
def test_a_changed_byte_or_a_missing_file_is_told(unets, tmp_path, where):
    directory = UPath(tmp_path)
    save_unets(unets, directory)
    file = directory / where
    data = bytearray(file.read_bytes())
    middle = len(data) // 2
    data[middle] ^= 1
    file.write_bytes(bytes(data))
    with pytest.raises(TactileError, match="materialise unet"):
        load_unets(directory)
    shutil.rmtree(tmp_path / "seed-7")
    with pytest.raises(TactileError, match="materialise unet"):
        load_unets(directory)


def test_policies_go_with_the_unet_of_their_seed_or_with_the_only_one(unets):
    assert unet_of(unets, 7) is unets[7]
    with pytest.raises(TactileError, match=r"no U-Net of seed 1 .* of seeds 4, 0, 7"):
        unet_of(unets, 1)
    only = {4: unets[4]}
    assert unet_of(only, 1) is only[4]


def test_a_training_does_not_depend_on_which_others_there_are():
    alone = settings_of_each(UNetSettings(epochs=3, seed=2))
    assert alone == [UNetSettings(epochs=3, seed=2)]
    first, second = settings_of_each(UNetSettings(epochs=3, seed=2, further_seeds=[0]))
    assert [first] == alone
    assert second == UNetSettings(epochs=3, seed=0)


def test_one_more_or_one_less_is_another_version(unets):
    assert version_of({4: unets[4]}) == unets[4].version()
    assert len({version_of(unets), version_of({4: unets[4], 0: unets[0]}), unets[4].version()}) == 3
