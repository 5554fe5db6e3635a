"""A changed byte, in any file that is stored, is found and named, and never read as other data."""

import io
import random
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
import torch
from upath import UPath

from tactile_core.checkpoints import load_checkpoint, save_checkpoint
from tactile_core.dataset.rendering.pictures import decode_masks, encode_mask
from tactile_core.errors import TactileError
from tactile_core.exploration.learning import train as learning
from tactile_core.exploration.learning.approaches import find_approach
from tactile_core.exploration.policies.store import describe, load_policies, trained_on
from tactile_core.parquet import read_table, table_hash, write_table
from tactile_core.reconstruction.trained import load_unet, save_unet
from tactile_core.settings import PolicySettings

QUICK = PolicySettings(
    steps_per_stage=64, environments=4, rays_per_rollout=16, batch_size=16, epochs=1
)
FLIPS = 150  # of one bit each, spread over a file


def flipped(whole: bytes, seed: int) -> Iterator[bytes]:
    """`whole` with one bit turned, at the ends and at random places between."""
    draw = random.Random(seed)
    places = [*range(8), *range(len(whole) - 12, len(whole))]
    places += [draw.randrange(len(whole)) for _ in range(FLIPS)]
    for place in places:
        damaged = bytearray(whole)
        damaged[place] ^= 1 << draw.randrange(8)
        yield bytes(damaged)


def noticed(file: Path, read: Callable[[], Any], says: str, seed: int = 0) -> tuple[int, int]:
    """How many flips of bits in `file` were told in one line that `says` what to do, and how many
    there were. Where one is not told, what is read must be what was written."""
    whole = file.read_bytes()
    messages: list[str] = []
    total = 0
    before = read()
    for damaged in flipped(whole, seed):
        file.write_bytes(damaged)
        total += 1
        try:
            assert read() == before
        except TactileError as error:
            messages.append(str(error))
    assert all(says in message and "\n" not in message for message in messages)
    file.write_bytes(whole)
    return len(messages), total


@pytest.fixture
def table() -> pd.DataFrame:
    rng = np.random.default_rng(0)
    outlines = [rng.integers(64, size=(n, 2), dtype=np.int16) for n in range(1, 9)]
    return pd.DataFrame(
        {
            "sample_id": [f"m{number}" for number in range(8)],
            "mask": [encode_mask(rng.random((64, 64)) < 0.5) for _ in range(8)],
            "outline": pd.Series(outlines, dtype=object),
            "jaccard": rng.random(8),
        }
    )


def test_every_bit_of_a_table_is_watched(table, tmp_path):
    file = tmp_path / "masks.parquet"
    write_table(table, file)
    told, total = noticed(
        file, lambda: table_hash(read_table(file)), f"{file} is damaged, as its checksum tells: "
        "materialise masks again",
    )  # fmt: skip
    assert told == total


@pytest.mark.parametrize("cut", [0, 1, 7, 8, 40, 0.5, 0.99])
def test_a_table_that_was_cut_short_is_told(table, tmp_path, cut):
    file = tmp_path / "masks.parquet"
    write_table(table, file)
    whole = file.read_bytes()
    file.write_bytes(whole[: int(cut * len(whole)) if isinstance(cut, float) else cut])
    with pytest.raises(TactileError, match="materialise masks again"):
        read_table(file)


def test_a_table_with_a_checksum_opens_with_other_software(table, tmp_path):
    write_table(table, tmp_path / "masks.parquet")
    whole = (tmp_path / "masks.parquet").read_bytes()
    assert pq.read_table(io.BytesIO(whole)).num_rows == len(table)
    assert pd.read_parquet(tmp_path / "masks.parquet")["jaccard"].tolist() == list(table["jaccard"])


def test_a_table_that_cannot_be_read_is_told(tmp_path):
    (tmp_path / "masks.parquet").mkdir()
    with pytest.raises(TactileError, match=r"cannot be read .*materialise masks again"):
        read_table(tmp_path / "masks.parquet")


def test_every_changed_bit_of_a_unet_is_noticed(unet, tmp_path):
    directory = UPath(tmp_path / "unet")
    save_unet(unet, directory)

    def read():
        again = load_unet(directory)
        return again.version(), again.settings, again.scores, table_hash(again.trained_on)

    for file in sorted(tmp_path.joinpath("unet").iterdir()):
        told, total = noticed(file, read, "materialise unet again")
        assert told > 0.9 * total, file  # white space in JSON may change


@pytest.fixture
def policy(shapes, unet, tmp_path) -> Callable[[], str]:
    """Trains a policy where none is kept, and returns its version."""

    def train() -> str:
        return learning.train_policy(
            find_approach("total"), 0, shapes["train"], unet, QUICK,
            directory=UPath(tmp_path / "total-0"), work=tmp_path / "work",
        )  # fmt: skip

    return train


def test_every_changed_bit_of_a_policy_is_noticed(policy, unet, tmp_path):
    policy()
    directory = UPath(tmp_path / "total-0")

    def read():
        load_policies([directory], unet.version(), 64)
        curve = read_table(directory / "curve.parquet", "policies")
        known = {name: table_hash(table) for name, table in trained_on([directory]).items()}
        return describe(directory), table_hash(curve), known

    for name in ("policy.safetensors", "settings.json", "curve.parquet", "trained_on.parquet"):
        told, total = noticed(tmp_path / "total-0" / name, read, "materialise policies again")
        assert told > 0.9 * total, name


@pytest.mark.parametrize(
    "name", ["policy.safetensors", "settings.json", "curve.parquet", "trained_on.parquet"]
)
def test_a_training_whose_files_are_damaged_is_not_kept(policy, tmp_path, name):
    version = policy()
    file = tmp_path / "total-0" / name
    whole = file.read_bytes()
    file.write_bytes(whole[:99] + bytes([whole[99] ^ 1]) + whole[100:])
    assert policy() == version
    assert file.read_bytes() == whole


def test_a_changed_bit_of_a_checkpoint_makes_the_work_start_over(tmp_path):
    file = tmp_path / "checkpoint.pt"
    save_checkpoint(file, "key", {"weights": torch.arange(500.0)})
    whole = file.read_bytes()
    for damaged in flipped(whole, 0):
        file.write_bytes(damaged)
        assert load_checkpoint(file, "key") is None


def test_a_picture_that_is_none_is_told(table):
    for damage in (b"", b"\x89PNG", table["mask"][0][:60], encode_mask(np.eye(48, dtype=bool))):
        with pytest.raises(TactileError, match="materialise masks and rotated_splits again"):
            decode_masks([table["mask"][0], damage])
