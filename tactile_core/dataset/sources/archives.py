"""Zip archives from elsewhere: what may be read from them, and what is refused.

Nothing here writes to disk. A member is read into memory, and its name is one that stays
inside any folder it is joined to.
"""

import re
import stat
import zipfile
from collections.abc import Collection
from pathlib import Path, PurePosixPath

from tactile_core.errors import TactileError

# Bytes of one mesh, unpacked: reading takes 5 to 13 times as much, 3.3 GB, in each worker.
MAX_FILE = 256 << 20
MAX_TOTAL = 64 << 30  # bytes of all meshes of an archive, unpacked
MAX_RATIO = 200  # unpacked : packed; OBJ text packs about 4 : 1
RATIO_MATTERS_FROM = 16 << 20  # smaller files do no harm, however well they pack
MAX_NAME = 200  # bytes of one part of a path; file systems take 255


def open_archive(path: Path) -> zipfile.ZipFile:
    """Open the zip file at `path`; raises `TactileError` where it is damaged or cut off."""
    try:
        return zipfile.ZipFile(path)
    except FileNotFoundError as error:
        raise TactileError(f"{path} is missing: put the archive there") from error
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError) as error:
        raise TactileError(
            f"{path} is damaged or not a zip file ({one_line(error)}): delete it and fetch it again"
        ) from error


def safe_members(archive: zipfile.ZipFile, suffixes: Collection[str]) -> list[str]:
    """The names of the members that end in one of `suffixes` (lower case), sorted.

    Raises `TactileError` for the whole archive where any member's path leads out of the
    folder it would be unpacked in, or is a link, and where one of the members asked for
    unpacks to more than the limits above.
    """
    total = 0
    names = set()
    for member in archive.infolist():
        problem = _path_problem(member.filename) or _kind_problem(member)
        wanted = PurePosixPath(member.filename).suffix.lower() in suffixes and not member.is_dir()
        if wanted and problem is None:
            total += member.file_size
            problem = _size_problem(member, total)
            names.add(member.filename)
        if problem:
            raise TactileError(
                f"{archive.filename} is refused: member {member.filename[:80]!r} {problem}; "
                "get the archive from a source that you trust"
            )
    return sorted(names)


def read_member(archive: zipfile.ZipFile, name: str) -> bytes:
    """The bytes of one member; raises `TactileError` where they are damaged.

    `zipfile` never unpacks more than the size that the archive's directory states, which
    `safe_members` has bounded.
    """
    try:
        return archive.read(name)
    except Exception as error:  # zipfile, zlib, bz2 and lzma have a dozen kinds between them
        raise TactileError(f"is damaged in its archive ({one_line(error)})") from error


def one_line(error: BaseException) -> str:
    """What an exception says, on one line of at most 200 characters."""
    return " ".join(str(error).split())[:200] or type(error).__name__


def _path_problem(name: str) -> str | None:
    parts = name.split("/")
    if name.startswith("/") or re.match(r"[A-Za-z]:", name):
        return "has an absolute path"
    if ".." in parts:
        return "leads out of its folder"
    if "\\" in name:
        return "has a backslash in its path"
    if any(len(part.encode()) > MAX_NAME for part in parts):
        return f"has a name of more than {MAX_NAME} bytes"
    return None


def _kind_problem(member: zipfile.ZipInfo) -> str | None:
    kind = stat.S_IFMT(member.external_attr >> 16)
    if kind == stat.S_IFLNK:
        return "is a link"
    if kind not in (0, stat.S_IFREG, stat.S_IFDIR):
        return "is neither a file nor a folder"
    return None


def _size_problem(member: zipfile.ZipInfo, total: int) -> str | None:
    if member.file_size > MAX_FILE:
        return f"unpacks to {member.file_size / 1e9:.1f} GB, more than {MAX_FILE / 1e9:.1f}"
    if total > MAX_TOTAL:
        return f"makes the meshes unpack to more than {MAX_TOTAL / 1e9:.1f} GB"
    if member.file_size > max(RATIO_MATTERS_FROM, MAX_RATIO * member.compress_size):
        return f"unpacks to more than {MAX_RATIO} times its size"
    return None
