"""Tables as Parquet files, whole and with a checksum inside, and the hash of what one holds."""

import contextlib
import hashlib
import io
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from typing import IO, Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from upath import UPath

from tactile_core.checksums import AT_A_TIME, is_whole_parquet, seal_parquet
from tactile_core.errors import DamagedError, OutOfReachError
from tactile_core.files import in_reach, is_local, written_whole

ROWS = 2**14  # of a table that are in memory more than once, and stored as one group


def write_table(table: pd.DataFrame, path: str | os.PathLike | UPath) -> None:
    """Write `table` as one Parquet file with a checksum, whole or not at all.

    A column of (K, 2) arrays, such as outlines, is stored as lists of pairs.
    """
    schema = _schema(table)
    with written_whole(path) as file:
        with pq.ParquetWriter(file, schema, compression="zstd") as writer:
            for part in _parts(table, schema):
                writer.write_table(part)
        seal_parquet(file)


def read_table(path: str | os.PathLike | UPath, asset: str | None = None) -> pd.DataFrame:
    """Read what `write_table` wrote, a column of lists of pairs as (K, 2) arrays.

    asset : that stores it; None: the one that the file is named after

    Raises `DamagedError` where the file is missing, or a byte of it has changed, and
    `OutOfReachError` where its disk does not let it be read, or its store does not answer.
    """
    source = UPath(path)
    remedy = f"materialise {asset or source.stem} again"
    try:
        with in_reach(source), _at_hand(source) as file:
            if not is_whole_parquet(file):
                raise DamagedError(f"{source} is damaged, as its checksum tells: {remedy}")
            stored = pq.ParquetFile(file)
            # As it was written: read whole, lists of pairs take four times the memory and time.
            groups = [stored.read_row_group(n) for n in range(stored.num_row_groups)]
            return _from_arrow(pa.concat_tables(groups))
    except FileNotFoundError as error:
        missing = f"{source} is missing: materialise {asset or source.stem} first"
        raise DamagedError(missing) from error
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise OutOfReachError(
            f"{source} cannot be read ({reason}): mend that, or remove it and {remedy}"
        ) from error


def table_hash(table: pd.DataFrame) -> str:
    """Hash of a table's columns, types and content (16 hex digits), whatever its index.

    It is taken from the memory format: a Parquet file names the library that wrote it.
    """
    schema = _schema(table)
    length = pa.MockOutputStream()
    _stream(table, schema, length)
    digest = hashlib.sha256(length.size().to_bytes(8, "little"))
    _stream(table, schema, pa.PythonFile(_Sink(digest.update), "w"))
    return digest.hexdigest()[:16]


@contextlib.contextmanager
def _at_hand(source: UPath) -> Iterator[IO[bytes]]:
    """A file to read more than once, as it is now: an object of a store is copied to a disk."""
    with source.open("rb") as file:
        if is_local(source):
            yield file
            return
        with tempfile.TemporaryFile() as copy:
            shutil.copyfileobj(file, copy, AT_A_TIME)
            yield copy


class _Sink(io.RawIOBase):
    """A file that hands on what is written to it."""

    def __init__(self, take: Callable[[memoryview], None]) -> None:
        self.take = take

    def writable(self) -> bool:
        return True

    def write(self, data: Any) -> int:
        self.take(data)
        return len(data)


def _stream(table: pd.DataFrame, schema: pa.Schema, sink: pa.NativeFile) -> None:
    with pa.ipc.new_stream(sink, schema) as stream:
        for part in _parts(table, schema):
            stream.write_table(part)


def _parts(table: pd.DataFrame, schema: pa.Schema) -> Iterator[pa.Table]:
    """A table in Arrow's form, `ROWS` at a time; at least one part."""
    for start in range(0, max(len(table), 1), ROWS):
        part = _to_arrow(table.iloc[start : start + ROWS]).cast(schema).combine_chunks()
        # Taken, as rows of a longer array would bring all of it: equal rows are equal bytes.
        yield part.take(np.arange(len(part)))


def _schema(table: pd.DataFrame) -> pa.Schema:
    """The columns' types as the first rows tell them or, where those are empty, later ones."""
    schema = _to_arrow(table.iloc[:ROWS]).schema
    for number, field in enumerate(schema):
        if pa.types.is_null(field.type):
            later = table[[field.name]].dropna().iloc[:1]
            schema = schema.set(number, _to_arrow(later).schema.field(0))
    return schema


def _to_arrow(table: pd.DataFrame) -> pa.Table:
    pairs = {
        name: pd.arrays.ArrowExtensionArray(pa.chunked_array([_lists_of_pairs(cells)]))
        for name, cells in table.items()
        if len(cells) and isinstance(cells.iloc[0], np.ndarray) and cells.iloc[0].ndim == 2
    }
    arrow = pa.Table.from_pandas(table.assign(**pairs), preserve_index=False)
    return arrow.replace_schema_metadata(None)


def _lists_of_pairs(cells: pd.Series) -> pa.ListArray:
    """Arrays (K, 2) as one Arrow array; row by row Arrow would not take them."""
    starts = np.cumsum([0, *map(len, cells)], dtype=np.int32)
    numbers = pa.array(np.concatenate(cells.to_list()).ravel())
    return pa.ListArray.from_arrays(starts, pa.FixedSizeListArray.from_arrays(numbers, 2))


def _from_arrow(arrow: pa.Table) -> pd.DataFrame:
    pairs = [
        field.name
        for field in arrow.schema
        if pa.types.is_list(field.type) and pa.types.is_fixed_size_list(field.type.value_type)
    ]
    table = arrow.drop_columns(pairs).to_pandas()
    for name in pairs:
        cells = [cell for lists in arrow[name].chunks for cell in _pairs(lists)]
        column = pd.Series(cells, dtype=object)
        table.insert(arrow.schema.get_field_index(name), name, column)
    return table


def _pairs(lists: pa.ListArray) -> list[np.ndarray]:
    """Lists of pairs as arrays (K, 2) that share their memory."""
    numbers = lists.flatten().flatten().to_numpy().reshape(-1, 2)
    ends = np.cumsum(lists.value_lengths().to_numpy())
    return np.split(numbers, ends[:-1]) if len(ends) else []
