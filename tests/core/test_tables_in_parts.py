"""Files are replaced as one, and tables in parts are the same tables, on a disk and in S3."""

from collections.abc import Iterator

import numpy as np
import pandas as pd
import pytest
from upath import UPath

from tactile_core import parquet
from tactile_core.files import written_whole
from tactile_core.parquet import read_table, table_hash, write_table
from tests.object_store import BUCKET, object_store


@pytest.fixture(params=["disk", "S3"])
def place(request, tmp_path, monkeypatch) -> Iterator[UPath]:
    if request.param == "disk":
        yield UPath(tmp_path)
    else:
        with object_store(monkeypatch):
            yield UPath(f"s3://{BUCKET}/store")


def write(path: UPath, *parts: bytes, fails: bool = False) -> None:
    with written_whole(path) as file:
        for part in parts:
            file.write(part)
            # Whoever looks while it is being written sees what was there before.
            assert not path.exists() or path.read_bytes() == b"before"
        if fails:
            raise OSError("the machine was switched off")


def test_a_file_is_replaced_as_one(place):
    write(place / "folder" / "file", b"before")
    write(place / "folder" / "file", b"after, ", b"and longer")
    assert (place / "folder" / "file").read_bytes() == b"after, and longer"


def test_a_file_whose_writing_fails_stays_what_it_was(place):
    write(place / "folder" / "file", b"before")
    for name in ("file", "other"):
        with pytest.raises(OSError, match="switched off"):
            write(place / "folder" / name, b"after", fails=True)
    assert [path.name for path in (place / "folder").iterdir()] == ["file"]
    assert (place / "folder" / "file").read_bytes() == b"before"


def test_names_with_signs_of_patterns_are_names(place):
    """Some file systems would take them for patterns when they move a file."""
    write(place / "step[gain_0]*?", b"data")
    assert (place / "step[gain_0]*?").read_bytes() == b"data"


def table() -> pd.DataFrame:
    """Words, numbers, bytes and lists of pairs; what a column holds shows late in some."""
    rng = np.random.default_rng(0)
    points = [rng.integers(0, 99, (count % 4, 2)).astype(np.int16) for count in range(20)]
    return pd.DataFrame(
        {
            "word": [f"w{number}" for number in range(20)],
            "number": rng.random(20),
            "bytes": pd.Series([None] * 15 + [b"data"] * 5, dtype=object),
            "points": pd.Series(points, dtype=object),
        }
    )


def test_a_table_in_parts_is_the_same_table(tmp_path, monkeypatch):
    write_table(table(), tmp_path / "at_once.parquet")
    monkeypatch.setattr(parquet, "ROWS", 6)
    write_table(table(), tmp_path / "in_parts.parquet")
    for name in ("at_once", "in_parts"):
        found = read_table(tmp_path / f"{name}.parquet")
        assert table_hash(found) == table_hash(table())
        pd.testing.assert_frame_equal(found.drop(columns="points"), table().drop(columns="points"))
        for one, other in zip(found["points"], table()["points"], strict=True):
            np.testing.assert_array_equal(one, other)
        assert len(pd.read_parquet(tmp_path / f"{name}.parquet")) == 20


def test_whichever_part_a_value_stands_in_another_one_is_another_hash(monkeypatch):
    monkeypatch.setattr(parquet, "ROWS", 6)
    hashes = {table_hash(table())}
    for row in range(20):
        other = table()
        other.loc[row, "number"] += 1
        hashes.add(table_hash(other))
    assert len(hashes) == 21
