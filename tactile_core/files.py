"""Files that appear whole or not at all, and hashes of what they hold."""

import contextlib
import hashlib
import io
import os
import uuid
from collections.abc import Iterator
from typing import IO, Any

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from upath import UPath

from tactile_core.errors import TactileError


@contextlib.contextmanager
def written_whole(path: str | os.PathLike | UPath) -> Iterator[IO[bytes]]:
    """Open `path` for binary writing; it appears under its name only when the block succeeds.

    Local files are written aside and renamed. Object stores publish an object when it is
    closed, so there a failed block closes nothing under the final name.
    """
    target = UPath(path)
    target.parent.mkdir(parents=True, exist_ok=True)
    aside = target.with_name(f".{target.name}.{uuid.uuid4().hex}.part")
    try:
        with aside.open("wb") as file:
            yield file
        target.fs.mv(aside.path, target.path)
    except BaseException:
        with contextlib.suppress(FileNotFoundError):
            aside.unlink()
        raise


def write_table(
    table: pd.DataFrame, path: str | os.PathLike | UPath, schema: pa.Schema | None = None
) -> None:
    """Write `table` as one Parquet file, whole or not at all."""
    arrow = pa.Table.from_pandas(table, schema=schema, preserve_index=False)
    with written_whole(path) as file:
        pq.write_table(arrow.replace_schema_metadata(None), file, compression="zstd")


def read_table(path: str | os.PathLike | UPath) -> pd.DataFrame:
    """Read a Parquet file; raises `TactileError` where it is missing or damaged."""
    source = UPath(path)
    if not source.exists():
        raise TactileError(f"{source} is missing: materialise the asset that writes it first")
    try:
        return pq.read_table(io.BytesIO(source.read_bytes())).to_pandas()
    except pa.ArrowInvalid as error:
        raise TactileError(f"{source} is not a readable Parquet file ({error}): delete it and "
                           "materialise its asset again") from error


def table_hash(table: pd.DataFrame) -> str:
    """Hash of a table's content (16 hex digits), independent of index and file format."""
    arrow = pa.Table.from_pandas(table, preserve_index=False).replace_schema_metadata(None)
    sink = io.BytesIO()
    pq.write_table(arrow, sink, compression="none")
    return content_hash(sink.getvalue())


def content_hash(*parts: bytes | str | Any) -> str:
    """Hash of bytes, or of the `repr` of anything else, in order (16 hex digits)."""
    digest = hashlib.sha256()
    for part in parts:
        data = part if isinstance(part, bytes) else repr(part).encode()
        digest.update(len(data).to_bytes(8, "little"))
        digest.update(data)
    return digest.hexdigest()[:16]
