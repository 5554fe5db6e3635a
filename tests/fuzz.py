"""Broken input at every door: each ends in a result or in one sentence that says what is wrong.

    python -m tests.fuzz --each 1000

Mesh files, archives, pictures, run configurations and every kind of stored file are damaged at
random, by the seed, and read. It prints how many gave a result and how many a `TactileError` of
one line; anything else is a fault, which is printed with the seed that shows it.
"""

import argparse
import contextlib
import json
import sys
import tempfile
import warnings
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import torch
from upath import UPath

from tactile_core.checkpoints import load_checkpoint, save_checkpoint
from tactile_core.dataset.drawings import mask_of_picture
from tactile_core.dataset.meshes import collect_meshes
from tactile_core.dataset.rendering.pictures import decode_masks, encode_mask
from tactile_core.dataset.sources.parsing import parse_mesh
from tactile_core.dataset.sources.places import find_places
from tactile_core.errors import TactileError
from tactile_core.exploration.policies.base import weights_version
from tactile_core.exploration.policies.store import (
    RAYS_OF_SEQUENCE,
    StoredPolicy,
    load_policies,
    save_policy,
    trained_on,
)
from tactile_core.parquet import read_table, table_hash, write_table
from tactile_core.reconstruction.trained import TrainedUNet, load_unet, save_unet
from tactile_core.reconstruction.unet import UNet
from tactile_core.settings import MeshSettings, PolicySettings, UNetSettings
from tests.core.dataset.mesh_files import MUG, V2, make_zip
from tests.core.dataset.sources import mesh_bytes as meshes

WORDS = [
    b"\n", b" ", b"-1", b"0", b"1e999", b"nan", b"4294967295", b"[", b"{}", b'"', b"\\\n", b"\x00",
    b"f 1 2 3\n", b"v 1 1 1\n", b"element", b"endsolid", b"PK\x03\x04", b"PAR1", b"glTF", b"IHDR",
]  # fmt: skip
VALUES = [
    None, True, -1, 0, 1, 2**70, 1e308, float("inf"), float("nan"), "", "x", "$NOWHERE", "../..",
    "\x00", [], [[]], [1, 1], ["total", "total"], {}, {"mug": "03797390"}, {"": None}, "é" * 300,
]  # fmt: skip


class Door(NamedTuple):
    """A way in.

    whole : inputs as they should be
    enter : reads one, from its bytes
    """

    name: str
    whole: list[bytes]
    enter: Callable[[bytes], Any]


class Outcome(NamedTuple):
    door: str
    results: int
    sentences: int
    faults: list[str]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--each", type=int, default=1000, help="inputs for each door")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    with tempfile.TemporaryDirectory() as folder:
        outcomes = []
        for door in doors(Path(folder)):
            outcome = fuzzed(door, options.each, options.seed)
            outcomes.append(outcome)
            faults = len(outcome.faults)
            said = f"{outcome.results} results, {outcome.sentences} sentences, {faults} faults"
            print(f"{door.name}: {said}", *outcome.faults[:5], sep="\n  ", flush=True)
    print(f"{options.each * len(outcomes)} inputs at {len(outcomes)} doors")
    sys.exit(any(outcome.faults for outcome in outcomes))


def fuzzed(door: Door, each: int, seed: int) -> Outcome:
    """What came of `each` damaged inputs at a door."""
    results, sentences, faults = 0, 0, []
    for number in range(each):
        rng = np.random.default_rng([seed, zlib.crc32(door.name.encode()), number])
        data = damaged(door.whole[rng.integers(len(door.whole))], rng)
        try:
            door.enter(data)
            results += 1
        except TactileError as error:
            sentences += 1
            if "\n" in str(error):
                faults.append(f"{door.name} {number}: more than a line: {error}")
        except Exception as error:  # whatever it is, it should have been a TactileError
            faults.append(f"{door.name} {number}: {type(error).__name__}: {str(error)[:200]}")
    return Outcome(door.name, results, sentences, faults)


def damaged(data: bytes, rng: np.random.Generator) -> bytes:
    """`data` after an accident, or four."""
    for _ in range(rng.choice([1, 1, 1, 4])):
        start, end = np.sort(rng.integers(0, len(data) + 1, 2))
        end = min(end, start + int(rng.choice([1, 4, 40, 4000])))
        word = WORDS[rng.integers(len(WORDS))]
        match rng.integers(7):
            case 0 if data:
                place = min(start, len(data) - 1)
                bit = data[place] ^ 1 << rng.integers(8)
                data = data[:place] + bytes([bit]) + data[place + 1 :]
            case 1:
                data = data[:start] + data[end:]
            case 2:
                data = data[:end] + data[start:end] + data[end:]
            case 3:
                data = data[:start] + rng.bytes(end - start) + data[end:]
            case 4:
                data = data[:start]
            case _:
                data = data[:start] + word + data[end:]
    return data


def doors(folder: Path) -> Iterator[Door]:
    """Every door; `folder` takes what has to lie somewhere."""
    yield from mesh_doors()
    yield archive_door(folder / "archive")
    picture = encode_mask(np.pad(np.ones((20, 20), bool), 22))
    yield Door("drawing", [picture], lambda data: mask_of_picture(data, 64))
    yield Door("mask in a table", [picture], lambda data: decode_masks([picture, data]))
    yield from config_doors()
    yield from stored_doors(folder / "stored")


def mesh_doors() -> Iterator[Door]:
    scene = [{"mesh": 0, "children": [1]}, {"mesh": 0, "translation": [0, 6, 0]}]
    binary = meshes.gltf([meshes.POINTS, meshes.CORNERS], [meshes.PLAIN], nodes=scene)
    files = {
        ".obj": [meshes.obj(), meshes.obj(polygons=meshes.POLYGONS).replace(b" ", b"/1/1 ")],
        ".ply": [meshes.ply(), meshes.binary_ply("<"), meshes.binary_ply(">", meshes.TRIANGLES)],
        ".off": [meshes.off(), meshes.off("OFF BINARY\n24 14 0\n")],
        ".stl": [meshes.binary_stl(), meshes.text_stl(2)],
        ".glb": [meshes.glb(*binary)],
    }
    for suffix, whole in files.items():
        yield Door(suffix, whole, lambda data, suffix=suffix: parse_mesh(data, suffix))  # type: ignore[misc]


def archive_door(folder: Path) -> Door:
    members = {f"{MUG}/{name}/{V2}": meshes.obj() for name in "ab"} | {"readme.txt": b"mugs"}
    archive = make_zip(folder / "source" / f"{MUG}.zip", members)
    settings = MeshSettings(classes={"mug": MUG}, location=str(archive.parent))

    def enter(data: bytes) -> None:
        archive.write_bytes(data)
        collect_meshes(settings, UPath(folder / "root"), folder / "cache")

    return Door(".zip", [archive.read_bytes()], enter)


def config_doors() -> Iterator[Door]:
    """Fields of a run's configuration with values that they are not made for."""
    from tactile_assets import dataset, evaluation, exploration, reconstruction

    for config in (
        dataset.MeshConfig, dataset.MaskConfig, dataset.SplitConfig, dataset.TouchConfig,
        reconstruction.SearchConfig, reconstruction.UNetConfig, exploration.PolicyConfig,
        evaluation.RolloutConfig, evaluation.PerStepConfig,
    ):  # fmt: skip

        def enter(data: bytes, config: type = config) -> None:
            rng = np.random.default_rng(zlib.crc32(data))
            fields = [*config.model_fields, "unheard_of"]  # type: ignore[attr-defined]
            chosen = rng.choice(fields, rng.integers(1, 4), replace=False)
            made = config(**{name: VALUES[rng.integers(len(VALUES))] for name in chosen})
            if isinstance(made, MeshSettings):
                find_places(made)

        yield Door(f"config: {config.__name__}", [config.__name__.encode()], enter)


def stored_doors(folder: Path) -> Iterator[Door]:
    """Each file of everything that is stored, damaged beside the others."""
    seen = pd.DataFrame({"model_id": ["m"], "geometry": ["g"]})
    for name, (write, read) in {
        "table": (write_some_table, read_table),
        "checkpoint": (
            lambda file: save_checkpoint(file, "key", {"weights": torch.ones(3)}),
            lambda file: load_checkpoint(file, "key"),
        ),
    }.items():
        file = folder / name
        folder.mkdir(parents=True, exist_ok=True)
        write(file)
        yield Door(f"stored: {name}", [file.read_bytes()], rewritten(file, read))
    unet = some_unet(seen)
    save_unet(unet, UPath(folder / "unet"))
    save_some_policy(UPath(folder / "policies" / "sequence-0"), seen)
    index = folder / "policies" / "index.json"
    policy = UPath(folder / "policies" / "sequence-0")
    index.write_text(json.dumps({"sequence-0": weights_version(some_rays())}))
    for file in sorted(folder.rglob("*")):
        of_unet = file.parent.name == "unet"
        if file.is_file() and (of_unet or file.is_relative_to(folder / "policies")):
            read = read_unet if of_unet else read_policies
            place = UPath(folder / "unet") if of_unet else policy
            name = f"stored: {file.parent.name}/{file.name}"
            enter = rewritten(file, lambda _, read=read, place=place: read(place))  # type: ignore[misc]
            yield Door(name, [file.read_bytes()], enter)


def rewritten(file: Path, read: Callable[[Any], Any]) -> Callable[[bytes], None]:
    """Reads `file` with other bytes in it, and puts its own back."""
    whole = file.read_bytes()

    def enter(data: bytes) -> None:
        file.write_bytes(data)
        try:
            read(file)
        finally:
            file.write_bytes(whole)

    return enter


def write_some_table(file: Path) -> None:
    points = [np.arange(2 * size, dtype=np.int16).reshape(-1, 2) for size in (3, 0, 5)]
    write_table(
        pd.DataFrame(
            {
                "sample_id": ["a", "b", "c"],
                "rotation": [0.5, 1.0, 359.0],
                "outline": pd.Series(points, dtype=object),
                "mask": pd.Series([encode_mask(np.eye(16, dtype=bool))] * 3, dtype=object),
            }
        ),
        file,
    )


def some_unet(seen: pd.DataFrame) -> TrainedUNet:
    weights = UNet(1, 4).state_dict()
    return TrainedUNet(
        weights=weights, resolution=64, depth=1, channels=4,
        settings=UNetSettings().model_dump(), scores={"epoch": 1.0},
        curve=pd.DataFrame({"epoch": [1]}), trained_on=seen.assign(split="train"),
    )  # fmt: skip


def some_rays() -> dict[str, torch.Tensor]:
    return {RAYS_OF_SEQUENCE: torch.arange(20).reshape(10, 2)}


def save_some_policy(directory: UPath, seen: pd.DataFrame) -> None:
    description = StoredPolicy(
        approach="sequence", learner="sequence", seed=0, settings=PolicySettings(), resolution=64,
        unet="unet", key="key", version=weights_version(some_rays()), trained_on=table_hash(seen),
    )  # fmt: skip
    save_policy(directory, description, some_rays(), pd.DataFrame({"steps": [1]}), seen)


def read_unet(directory: UPath) -> None:
    load_unet(directory)


def read_policies(directory: UPath) -> None:
    """As the evaluations do, from the index."""
    import dagster as dg

    from tactile_assets.io_managers import PolicyIndex

    with dg.build_input_context() as context:
        manager = PolicyIndex(base_path=directory.parent.parent)
        directories = manager.load_from_path(context, directory.parent)
    load_policies(directories, "unet", 64)
    trained_on(directories)
    for path in directories:
        read_table(path / "curve.parquet", "policies")


if __name__ == "__main__":
    with contextlib.suppress(BrokenPipeError):
        main()
