"""Folders of meshes, on this machine or in an object store: what lies in them, and reading it.

Regular files only: a pipe would be waited for, a device never ends, and a link that leads out of
the folder brings what nobody meant to give.
"""

import os
import stat
from pathlib import Path
from typing import NamedTuple

from upath import UPath

from tactile_core.addresses import one_line, shown
from tactile_core.dataset.sources.archives import MAX_FILE, read_pieces, too_large
from tactile_core.errors import TactileError, spelt
from tactile_core.files import is_local


class Listing(NamedTuple):
    """What lies below a folder, each by its relative path and sorted by it."""

    files: dict[str, dict]  # length and time or ETag, as fsspec has it
    left_out: dict[str, str]  # why it is not read; on one line, that of a folder ends in a slash


def as_path(address: str) -> UPath:
    """A local path or fsspec URL, whose file system forgets what it knew of its folders.

    Raises `TactileError` where that file system is not installed, or cannot be reached so.
    """
    try:
        path = UPath(address) if "://" in address else UPath(address).expanduser()
        path.fs.invalidate_cache()  # else an object store answers from its first listing
    except Exception as error:  # every fsspec file system has errors of its own
        raise TactileError(f"{shown(address)} cannot be opened: {one_line(error)}") from None
    return path


def as_local(path: UPath) -> Path | None:
    """`path` as a plain path, if it lies on this machine."""
    return Path(path.path) if is_local(path) else None


def parts_below(path: UPath, folder: UPath) -> tuple[str, ...] | None:
    """The parts of `path` below `folder`; None where it does not lie there."""
    local, local_folder = as_local(path), as_local(folder)
    if local is not None and local_folder is not None:
        own, above = local.resolve().parts, local_folder.resolve().parts
    elif local is None and local_folder is None and path.protocol == folder.protocol:
        own, above = (tuple(p.path.strip("/").split("/")) for p in (path, folder))
    else:
        return None
    return own[len(above) :] if own[: len(above)] == above else None


def walk(folder: UPath) -> Listing:
    """Every regular file below `folder`, and what else is there.

    Links are followed where they stay below `folder`, and each folder is entered once.
    """
    local = as_local(folder)
    if local is not None:
        return _walk_local(local)
    try:
        found = folder.fs.find(folder.path, detail=True)
    except Exception as error:  # every fsspec file system has errors of its own
        raise TactileError(f"{shown(str(folder))} cannot be listed: {one_line(error)}") from None
    start = len(folder.path.rstrip("/")) + 1
    files = {path[start:]: info for path, info in sorted(found.items())}
    # An object that is called as the folder, or ends in a slash, stands for a folder itself.
    files = {path: info for path, info in files.items() if path and not path.endswith("/")}
    odd = {p: "is no regular file" for p, info in files.items() if info.get("type") != "file"}
    return Listing({path: info for path, info in files.items() if path not in odd}, odd)


def read_file(path: UPath) -> bytes:
    """The bytes of a file; raises `TactileError`, without its name, where it cannot be read."""
    try:
        with path.open("rb") as file:
            data = read_pieces(file, MAX_FILE + 1)
            if len(data) > MAX_FILE:
                raise TactileError(too_large(path.stat().st_size))
    except TactileError:
        raise
    except Exception as error:  # every fsspec file system has errors of its own
        raise TactileError(f"cannot be read ({one_line(error)})") from None
    return data


def _walk_local(top: Path) -> Listing:
    files: dict[str, dict] = {}
    left_out: dict[str, str] = {}
    visited: set[str] = set()
    inside = os.path.realpath(top)

    def relative(path: str | Path) -> str:
        return Path(path).relative_to(top).as_posix()

    def unreadable(error: OSError) -> None:
        left_out[f"{spelt(relative(error.filename))}/"] = f"cannot be read ({error.strerror})"

    for here, folders, names in os.walk(top, followlinks=True, onerror=unreadable):
        if os.path.realpath(here) in visited:
            folders.clear()
            continue
        visited.add(os.path.realpath(here))
        folders.sort(key=lambda name: (name.startswith("."), name))  # hidden ones are not read
        for name in [*folders]:
            if _leads_out(Path(here, name), inside):
                folders.remove(name)
                left_out[f"{spelt(relative(Path(here, name)))}/"] = OUT
        for name in names:
            path = Path(here, name)
            problem, info = _look_at(path, inside)
            if problem:
                left_out[spelt(relative(path))] = problem
            else:
                files[relative(path)] = info
    return Listing(dict(sorted(files.items())), dict(sorted(left_out.items())))


OUT = "is a link that leads out of its folder: put there what it leads to"


def _leads_out(path: Path, inside: str) -> bool:
    return path.is_symlink() and not Path(os.path.realpath(path)).is_relative_to(inside)


def _look_at(path: Path, inside: str) -> tuple[str | None, dict]:
    """Why a local file is not read, or None, and its length and time."""
    try:
        str(path).encode()
        state = path.stat()
        if not stat.S_ISREG(state.st_mode):
            return "is no regular file but a pipe, a device or the like", {}
        if _leads_out(path, inside):
            return OUT, {}
    except UnicodeEncodeError:
        return "has a name that is not UTF-8: rename it", {}
    except OSError as error:
        where = "is a link that leads nowhere" if path.is_symlink() else "cannot be looked at"
        return f"{where} ({error.strerror})", {}
    return None, {"size": state.st_size, "mtime": state.st_mtime_ns}
