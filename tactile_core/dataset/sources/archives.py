"""Zip archives from elsewhere: what may be read from them, and what is refused.

Nothing here writes to disk. A member is read into memory in pieces, never more than it declares,
and its name is one that stays inside any folder it is joined to.
"""

import copy
import re
import stat
import zipfile
import zlib
from collections.abc import Collection
from pathlib import Path, PurePosixPath
from typing import IO

from tactile_core.addresses import one_line
from tactile_core.dataset.sources.looks import what_it_is
from tactile_core.errors import TactileError

# Bytes of one mesh, unpacked: reading takes 5 to 13 times as much, 3.3 GB, in each worker.
MAX_FILE = 256 << 20
MAX_TOTAL = 64 << 30  # bytes of all meshes of an archive, unpacked
MAX_RATIO = 200  # unpacked : packed; OBJ text packs about 4 : 1
RATIO_MATTERS_FROM = 16 << 20  # smaller files do no harm, however well they pack
PIECE = 1 << 20  # bytes unpacked at a time
# All others unpack in one go, however much it is, and no one packs meshes with them.
METHODS = {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED}
METHOD_NAMES = {
    1: "shrink", 6: "implode", 9: "deflate64", 12: "bzip2", 14: "LZMA", 20: "zstd", 93: "zstd",
    95: "xz", 98: "PPMd",
}  # fmt: skip
ENCRYPTED = 1  # bit of a member's flags


def open_archive(path: Path, name: str | None = None) -> zipfile.ZipFile:
    """Open the zip file at `path`; raises `TactileError` where it is none, damaged or cut off.

    name : what messages call it, where it is the copy of something elsewhere
    """
    name = name or str(path)
    try:
        if kind := what_it_is(path):
            raise TactileError(f"{name} {kind}")
        return zipfile.ZipFile(path)
    except FileNotFoundError as error:
        raise TactileError(f"{name} is missing: put the archive there") from error
    except TactileError:
        raise
    except UnicodeDecodeError as error:  # nothing in it can be read by `zipfile` then
        raise TactileError(
            f"{name} has a member whose name is not in UTF-8, as it says it is: pack it anew"
        ) from error
    except Exception as error:  # zipfile and struct have a dozen kinds between them
        raise TactileError(
            f"{name} is a zip archive that is damaged or cut off ({one_line(error)}): "
            "get a whole copy of it"
        ) from error


def safe_members(archive: zipfile.ZipFile, suffixes: Collection[str]) -> dict[str, zipfile.ZipInfo]:
    """The members that end in one of `suffixes` (lower case), by path and sorted by it.

    Raises
    `TactileError` for the whole archive where any member's path leads out of the folder it would
    be unpacked in, or is a link, and where one of the members asked for packs too well, or all
    of them unpack to more than the limit.
    """
    total = 0
    wanted = {}
    for member in archive.infolist():
        path = path_of(member)
        problem = _path_problem(path) or _kind_problem(member)
        is_mesh = PurePosixPath(path).suffix.lower() in suffixes and not path.endswith("/")
        if is_mesh and problem is None:
            if member.file_size <= MAX_FILE:  # larger ones are never unpacked
                total += member.file_size
                problem = _size_problem(member, total)
            wanted[path] = member
        if problem:
            raise TactileError(
                f"{archive.filename} is refused: member {member.orig_filename[:80]!r} {problem}; "
                "get the archive from a source that you trust"
            )
    return dict(sorted(wanted.items()))


def path_of(member: zipfile.ZipInfo) -> str:
    """A member's path as it stands in the archive, with slashes for the backslashes of Windows.

    What `zipfile` calls its name ends at the first zero byte, so that a mesh may seem to be none.
    """
    return member.orig_filename.replace("\\", "/")


def read_member(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> bytes:
    """The bytes of one member.

    Raises `TactileError`, without the member's name, where they are damaged, encrypted, packed in
    a way that is not read, or more than the archive says or the limit allows.
    """
    if member.file_size > MAX_FILE:
        raise TactileError(too_large(member.file_size))
    if member.flag_bits & ENCRYPTED:
        raise TactileError("is encrypted: pack it anew without a password")
    if member.compress_type not in METHODS:
        method = METHOD_NAMES.get(member.compress_type, f"method {member.compress_type}")
        raise TactileError(
            f"is packed with {method}, which is not read: pack it anew with deflate, as zip does"
        )
    # With one byte more allowed it shows where a member holds more than it says. `zipfile` would
    # unpack it whole to compare checksums; that is done here.
    allowed = copy.copy(member)
    allowed.file_size += 1
    allowed.CRC = None  # type: ignore[assignment]
    try:
        with archive.open(allowed) as file:
            data = read_pieces(file, allowed.file_size)
    except Exception as error:  # zipfile and zlib have a dozen kinds between them
        raise TactileError(f"is damaged in its archive ({one_line(error)})") from error
    if len(data) != member.file_size:
        kind = "more" if len(data) > member.file_size else "less"
        raise TactileError(
            f"is damaged in its archive (it holds {kind} than the {member.file_size} bytes it says)"
        )
    if zlib.crc32(data) != member.CRC:
        raise TactileError("is damaged in its archive (Bad CRC-32: another checksum)")
    return data


def read_pieces(file: IO[bytes], most: int) -> bytes:
    """A file up to its end or `most` bytes, read in pieces."""
    data = bytearray()
    while piece := file.read(min(PIECE, most - len(data))):
        data += piece
    return bytes(data)


def too_large(size: int) -> str:
    """Why a mesh of `size` bytes is not read."""
    return f"has {size / 1e6:.1f} MB, more than the {MAX_FILE / 1e6:.1f} MB that are read"


def _path_problem(name: str) -> str | None:
    parts = name.split("/")
    if name.startswith("/") or re.match(r"[A-Za-z]:", name):
        return "has an absolute path"
    if ".." in parts:
        return "leads out of its folder"
    return None


def _kind_problem(member: zipfile.ZipInfo) -> str | None:
    kind = stat.S_IFMT(member.external_attr >> 16)
    if kind == stat.S_IFLNK:
        return "is a link"
    if kind not in (0, stat.S_IFREG, stat.S_IFDIR):
        return "is neither a file nor a folder"
    return None


def _size_problem(member: zipfile.ZipInfo, total: int) -> str | None:
    if total > MAX_TOTAL:
        return f"makes the meshes unpack to more than {MAX_TOTAL / 1e9:.1f} GB"
    if member.file_size > max(RATIO_MATTERS_FROM, MAX_RATIO * member.compress_size):
        return f"unpacks to more than {MAX_RATIO} times its size"
    return None
