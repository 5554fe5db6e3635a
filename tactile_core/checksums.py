"""Checksums that files carry inside them: a changed byte is found before anything is made of it."""

import hashlib
import io
import json
from typing import IO, Any, TypeVar

from tactile_core.settings import Settings

DIGEST = 32  # bytes of a SHA-256
AT_A_TIME = 2**20  # bytes
CHECKSUM = "checksum"

Described = TypeVar("Described", bound=Settings)


def sealed(data: bytes) -> bytes:
    """`data` with its SHA-256 before it."""
    return hashlib.sha256(data).digest() + data


def unsealed(data: bytes) -> bytes:
    """What `sealed` was given; raises `ValueError` where a byte of it has changed."""
    if hashlib.sha256(data[DIGEST:]).digest() != data[:DIGEST]:
        raise ValueError("was altered, as its checksum tells")
    return data[DIGEST:]


def seal_parquet(file: IO[bytes]) -> None:
    """Put into a Parquet file, which is open for reading and writing, the SHA-256 of all the rest.

    It lies just before the footer, where readers do not look: they find the footer from the end
    and the columns from the start, so the file opens everywhere.
    """
    end = file.seek(0, io.SEEK_END)
    start = _footer(file, end)
    digest = _digest(file, (0, end))
    file.seek(start)
    footer = file.read()
    file.seek(start)
    file.write(digest + footer)


def is_whole_parquet(file: IO[bytes]) -> bool:
    """Whether every byte of a file is as `seal_parquet` left it."""
    end = file.seek(0, io.SEEK_END)
    if end < DIGEST + 8:
        return False
    start = _footer(file, end)
    if start < DIGEST:
        return False
    file.seek(start - DIGEST)
    return file.read(DIGEST) == _digest(file, (0, start - DIGEST), (start, end))


def sealed_json(description: Settings) -> bytes:
    """A description as JSON that holds the checksum of its other values."""
    values = description.model_dump(mode="json")
    return json.dumps({**values, CHECKSUM: _checksum(values)}, indent=2).encode()


def unsealed_json(data: bytes, kind: type[Described]) -> Described:
    """What `sealed_json` was given; raises `ValueError` where it is damaged or no such thing."""
    values = json.loads(data)
    if not isinstance(values, dict):
        raise ValueError("holds no description")
    checksum = values.pop(CHECKSUM, None)
    description = kind.model_validate(values)
    if checksum != _checksum(values):
        raise ValueError("was altered, as its checksum tells")
    return description


def _checksum(values: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:16]


def _footer(file: IO[bytes], end: int) -> int:
    """Where the footer of a Parquet file begins: its length stands before the last four bytes."""
    file.seek(end - 8)
    return end - 8 - int.from_bytes(file.read(4), "little")


def _digest(file: IO[bytes], *parts: tuple[int, int]) -> bytes:
    """The SHA-256 of the bytes from one place to another, of each part in turn."""
    digest = hashlib.sha256()
    for start, end in parts:
        file.seek(start)
        while start < end:
            data = file.read(min(AT_A_TIME, end - start))
            digest.update(data)
            start += len(data)
    return digest.digest()
