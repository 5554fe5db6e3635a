"""Files that appear whole or not at all, and hashes of what they hold."""

import contextlib
import errno
import hashlib
import os
import re
import tempfile
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

from upath import UPath

from tactile_core.addresses import one_line
from tactile_core.errors import OutOfReachError, TactileError

PART = re.compile(r"\.[0-9a-f]{32}\.part")  # a file while it is written
# What no second try mends, and what does.
REMEDIES = {
    errno.ENOSPC: "make room",
    errno.EDQUOT: "make room",
    errno.EFBIG: "allow larger files",
    errno.EROFS: "mount it to be written to, or name another store",
    errno.EACCES: "allow it to be written to, or name another store",
    errno.EPERM: "allow it to be written to, or name another store",
}


def is_local(path: UPath) -> bool:
    """Whether a path is of this machine's own file system, not of an object store or server."""
    return path.protocol in ("", "file", "local")


@contextlib.contextmanager
def written_whole(path: str | os.PathLike | UPath) -> Iterator[IO[bytes]]:
    """Open `path` to write (and read) bytes; it appears under its name only if the block succeeds.

    Raises `TactileError` where the disk is full or the place is not to be written to, and
    `OutOfReachError` where its store does not take it.
    """
    try:
        with _written_whole(path) as file:
            yield file
    except OSError as error:
        if error.errno not in REMEDIES:
            raise
        raise TactileError(
            f"{path} cannot be written ({error.strerror}): {REMEDIES[error.errno]}, then run again"
        ) from error


def remove_parts(folder: Path) -> int:
    """Remove the half-written files below `folder`, where nobody else writes; how many they were.

    Downloads, which go on where they broke off, have other names.
    """
    parts = [
        Path(place, name)
        for place, _, names in os.walk(folder)
        for name in names
        if PART.fullmatch(name)
    ]
    for part in parts:
        part.unlink(missing_ok=True)
    return len(parts)


def remove_folder(folder: Path | UPath) -> None:
    """Remove a folder, on a disk or in an object store, if it is there."""
    place = UPath(folder)
    if place.exists():
        place.fs.rm(place.path, recursive=True)


@contextlib.contextmanager
def _written_whole(path: str | os.PathLike | UPath) -> Iterator[IO[bytes]]:
    """On a disk it is written aside and renamed. An object store has no rename, but an object there
    appears when it has been sent: it is written on this machine first.
    """
    target = UPath(path)
    if is_local(target):
        local = Path(target.path)
        local.parent.mkdir(parents=True, exist_ok=True)
        # A name of its own, short whatever the target's is: file systems take 255 bytes.
        aside = local.with_name(f".{uuid.uuid4().hex}.part")
        try:
            with aside.open("w+b") as file:
                yield file
            aside.replace(local)
        except BaseException:
            aside.unlink(missing_ok=True)
            raise
        return
    with tempfile.TemporaryDirectory() as folder:
        aside = Path(folder, "part")
        with aside.open("w+b") as file:
            yield file
        with in_reach(target, "written"):
            target.fs.put_file(str(aside), target.path)


def stored_bytes(path: UPath) -> bytes:
    """The bytes of a stored file; raises `OSError`, and `OutOfReachError` where an object store has
    another error, as without a key."""
    with in_reach(path):
        return path.read_bytes()


def kept_bytes(path: UPath) -> bytes:
    """The bytes of what earlier work has kept. Raises `FileNotFoundError` or `NotADirectoryError`
    where there is nothing, and `OutOfReachError` where it cannot be read now, as of a busy store or
    a disk that fails: it may be whole, and hours of work would be done again."""
    try:
        return stored_bytes(path)
    except (FileNotFoundError, NotADirectoryError):
        raise
    except OSError as error:
        raise OutOfReachError(f"{path} cannot be read ({one_line(error)}): mend that") from error


@contextlib.contextmanager
def in_reach(path: UPath, done: str = "read") -> Iterator[None]:
    """Raises `OutOfReachError` for what an object store's client raises besides `OSError`.

    done : what was to be done with `path`
    """
    try:
        yield
    except Exception as error:
        if is_local(path) or isinstance(error, OSError | TactileError):
            raise
        raise OutOfReachError(f"{path} cannot be {done} ({one_line(error)}): mend that") from error


def content_hash(*parts: bytes | str | Any) -> str:
    """Hash of bytes, or of the `repr` of anything else, in order (16 hex digits)."""
    digest = hashlib.sha256()
    for part in parts:
        data = part if isinstance(part, bytes) else repr(part).encode()
        digest.update(len(data).to_bytes(8, "little"))
        digest.update(data)
    return digest.hexdigest()[:16]
