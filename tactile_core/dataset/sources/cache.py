"""The cache of archives: one folder per address, with a record of what the source said of it.

`<name>.part` grows until the file is whole, then takes its name. A small JSON record beside
it (`<name>.json`) tells later whether the source still holds the same file.
"""

import errno
import hashlib
import json
import re
import time
from collections.abc import Callable
from pathlib import Path
from urllib.parse import unquote, urlsplit

from filelock import FileLock
from upath import UPath

from tactile_core.addresses import one_line, shown
from tactile_core.errors import OutOfReachError, TactileError
from tactile_core.files import content_hash

FULL = (errno.ENOSPC, errno.EDQUOT)
PIECE = 1 << 16  # bytes read at a time; a broken download loses less than one piece
# What changes with the bytes; what changes whenever they are written, be they the same ones.
VERSION_KEYS = (
    ("ETag", "etag", "md5Hash"),
    # The last is FTP's.
    ("LastModified", "last_modified", "updated", "mtime", "modified", "modify"),
)


def cache_path(address: str, folder: Path) -> Path:
    """Where the file at `address` lies in the cache, under a name like its own."""
    name = unquote(urlsplit(address).path).rstrip("/").rpartition("/")[2]
    place = folder / content_hash(address)
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise TactileError(f"{place} cannot be made ({error.strerror}): mend that") from error
    return place / (re.sub(r"[^\w.-]", "_", name)[-100:].strip(".") or "download")


def part_of(target: Path) -> Path:
    """Where `target` grows until it is whole."""
    return target.with_name(f"{target.name}.part")


def read_record(path: Path) -> dict[str, str]:
    """What was recorded of a file; empty where it is missing or has another length by now."""
    try:
        record = dict(json.loads(_record_path(path).read_text()))
        size = path.stat().st_size
        length = int(record.get("length", size))
    except (FileNotFoundError, ValueError, TypeError):  # the latter two of a damaged record
        return {}
    return {} if path.suffix != ".part" and length != size else record


def write_record(path: Path, record: dict[str, str]) -> None:
    _record_path(path).write_text(json.dumps(record))


def accept_part(target: Path) -> None:
    """Give a finished `.part` its name, and its record with it."""
    part = part_of(target)
    part.replace(target)
    _record_path(part).replace(_record_path(target))


def forget(path: Path) -> None:
    """Remove a cached file and its record."""
    path.unlink(missing_ok=True)
    _record_path(path).unlink(missing_ok=True)


def copy_object(source: UPath, folder: Path, progress: Callable[[str], None]) -> Path:
    """A file of any fsspec file system as a local one; copied only when it has changed."""
    target = cache_path(str(source), folder)
    with FileLock(f"{target}.lock"):
        try:
            info = source.fs.info(source.path)
            version = object_version(info)
            record = {"version": version or "", "length": str(info["size"])}
            if version and read_record(target) == record:
                return target
            part = part_of(target)
            reporter = Reporter(target.name, info["size"], progress)
            with source.open("rb") as remote, part.open("wb") as file:
                while piece := remote.read(PIECE):
                    file.write(piece)
                    reporter.at(file.tell())
                size = file.tell()
        except Exception as error:  # every fsspec file system has errors of its own
            if isinstance(error, OSError) and error.errno in FULL:
                raise TactileError(f"{folder} is full: make room there, then run again") from None
            raise failure(error)(
                f"{shown(str(source))} cannot be copied ({one_line(error)}): look at the address "
                "and the network, then run again"
            ) from None
        if size != info["size"]:
            raise OutOfReachError(
                f"{shown(str(source))} broke off after {size} of {info['size']} bytes: run again"
            )
        write_record(part, record)
        accept_part(target)
        return target


def failure(error: Exception) -> type[TactileError]:
    """What kind of error stands for one of a file system: whether it may pass by itself."""
    lasting = isinstance(error, PermissionError | FileNotFoundError | ValueError)
    return TactileError if lasting else OutOfReachError


def object_version(info: dict) -> str | None:
    """What tells two versions of a file apart, from its fsspec `info`: length and ETag, or time.

    None where its file system tells neither: a length alone may be that of another version.
    """
    for keys in VERSION_KEYS:
        if known := {key: str(info[key]) for key in keys if info.get(key) is not None}:
            return repr((info.get("size"), known))
    # Only file systems with none of these, as fsspec's memory, need the time of creation.
    created = info.get("created")
    return None if created is None else repr((info.get("size"), str(created)))


def file_sha256(path: Path) -> str:
    """SHA-256 of a file's bytes (hex)."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


class Reporter:
    """Tells percent and MB at the start, every few seconds and at the end."""

    def __init__(self, name: str, total: int | None, progress: Callable[[str], None]):
        self.name, self.total, self.progress = name, total, progress
        self.last = float("-inf")

    def at(self, size: int) -> None:
        now = time.monotonic()
        if now - self.last < 3 and size != self.total:
            return
        self.last = now
        if self.total:
            share = f"{100 * size / self.total:.0f} % of {self.total / 1e6:.1f} MB"
        else:
            share = f"{size / 1e6:.1f} MB"
        self.progress(f"{self.name}: {share}")


def _record_path(path: Path) -> Path:
    return path.with_name(f"{path.name}.json")
