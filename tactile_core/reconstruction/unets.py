"""U-Nets that differ in nothing but their seed, by that seed.

What a table says of policies should hold for more than one training of the U-Net. So there can be
several, and the policies of each seed are trained and evaluated with the U-Net of that seed.
"""

from collections.abc import Iterable, Mapping

from upath import UPath

from tactile_core.checksums import sealed_json, unsealed_json
from tactile_core.errors import OutOfReachError, TactileError
from tactile_core.files import content_hash, kept_bytes, remove_folder, written_whole
from tactile_core.reconstruction.trained import TrainedUNet, load_unet, save_unet
from tactile_core.settings import Settings, UNetSettings

UNets = dict[int, TrainedUNet]  # the first is that of `UNetSettings.seed`, for whoever needs one

INDEX = "seeds.json"


class StoredUNets(Settings):
    """Which U-Nets a training left, in their order."""

    version_of_seed: dict[int, str]


def settings_of_each(settings: UNetSettings) -> list[UNetSettings]:
    """The settings of each training; none of them depends on which others there are."""
    return [
        settings.model_copy(update={"seed": seed, "further_seeds": []})
        for seed in (settings.seed, *settings.further_seeds)
    ]


def unet_of(unets: Mapping[int, TrainedUNet], seed: int) -> TrainedUNet:
    """The U-Net that policies of this seed go with; raises `TactileError` as `seed_of` does."""
    return unets[seed_of(unets, seed)]


def seed_of(unets: Mapping[int, TrainedUNet], seed: int) -> int:
    """The seed of the U-Net that policies of this seed go with: the same, or that of the only one.

    Raises `TactileError` where there are several, and none of this seed.
    """
    if len(unets) == 1:
        return next(iter(unets))
    if seed not in unets:
        raise TactileError(
            f"there is no U-Net of seed {seed} for the policies of that seed, but of seeds "
            f"{', '.join(map(str, unets))}: add it to unet's further_seeds, or leave these empty"
        )
    return seed


def first_of(unets: Mapping[int, TrainedUNet]) -> TrainedUNet:
    """The U-Net for whoever needs just one."""
    return next(iter(unets.values()))


def version_of(unets: Mapping[int, TrainedUNet]) -> str:
    """Hash of all of them (16 hex digits)."""
    if len(unets) == 1:
        return first_of(unets).version()
    return content_hash({seed: unet.version() for seed, unet in unets.items()})


def save_unets(unets: Mapping[int, TrainedUNet], directory: UPath) -> None:
    """Write each as `save_unet` does, the first in `directory` itself, and, last, which belong
    together; the folders of other seeds go."""
    places = places_of(unets, directory)
    for seed, unet in unets.items():
        save_unet(unet, places[seed])
    index = StoredUNets(version_of_seed={seed: unet.version() for seed, unet in unets.items()})
    with written_whole(directory / INDEX) as file:
        file.write(sealed_json(index))
    for folder in directory.glob("seed-*"):
        if folder not in places.values():
            remove_folder(folder)


def load_unets(directory: UPath) -> UNets:
    """Read what `save_unets` wrote, or `save_unet`; raises `TactileError` where it is missing or
    damaged."""
    one = load_unet(directory)
    try:
        versions = unsealed_json(kept_bytes(directory / INDEX), StoredUNets).version_of_seed
    except FileNotFoundError:
        return {one.settings.get("seed", 0): one}
    except OutOfReachError:
        raise
    except (OSError, ValueError) as error:
        raise TactileError(f"{directory}/{INDEX} is damaged: materialise unet again") from error
    places = places_of(versions, directory)
    unets = {
        seed: one if place == directory else load_unet(place) for seed, place in places.items()
    }
    for seed, unet in unets.items():
        if unet.version() != versions[seed]:
            raise TactileError(
                f"{places[seed]} is of another training than {INDEX} says: materialise unet again"
            )
    return unets


def places_of(seeds: Iterable[int], directory: UPath) -> dict[int, UPath]:
    """Where the U-Net of each seed lies."""
    return {
        seed: directory / f"seed-{seed}" if number else directory
        for number, seed in enumerate(seeds)
    }
