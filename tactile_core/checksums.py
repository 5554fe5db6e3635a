"""Checksums that files carry inside them: a changed byte is found before anything is made of it."""

import hashlib
import json
from typing import Any, TypeVar

from tactile_core.settings import Settings

DIGEST = 32  # bytes of a SHA-256
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


def sealed_parquet(data: bytes | memoryview) -> tuple[memoryview, bytes, memoryview]:
    """A Parquet file in three parts: in the middle the SHA-256 of the other two.

    It lies just before the footer, where readers do not look: they find the footer from the end
    and the columns from the start, so the file opens everywhere.
    """
    data = memoryview(data)
    start = _footer(data)
    return data[:start], _digest(data[:start], data[start:]), data[start:]


def is_whole_parquet(data: bytes) -> bool:
    """Whether every byte of a file is as `sealed_parquet` gave it."""
    view = memoryview(data)
    start = _footer(view)
    if start < DIGEST:
        return False
    columns, digest, footer = view[: start - DIGEST], view[start - DIGEST : start], view[start:]
    return _digest(columns, footer) == digest


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


def _footer(data: memoryview) -> int:
    """Where the footer of a Parquet file begins: its length stands before the last four bytes."""
    return len(data) - 8 - int.from_bytes(data[-8:-4], "little")


def _digest(*parts: memoryview) -> bytes:
    digest = hashlib.sha256()
    for part in parts:
        digest.update(part)
    return digest.digest()
