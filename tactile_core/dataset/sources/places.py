"""Where the meshes of each class lie, and whether they have changed.

A class is found at the location as `<synset>.zip`, as an extracted `<synset>/`, or as
`<class>/`, a folder of a user's own objects; or it has an archive or a folder of its own.
"""

import contextlib
import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit, urlunsplit

from upath import UPath

from tactile_core.dataset.sources.archives import one_line
from tactile_core.dataset.sources.cache import copy_object, object_version
from tactile_core.dataset.sources.download import (
    MissingFileError,
    download,
    remote_version,
    shown,
    verify_sha256,
)
from tactile_core.errors import TactileError
from tactile_core.files import content_hash
from tactile_core.settings import MeshSettings


class MissingClassError(TactileError):
    """A class that is found nowhere."""


@dataclass(frozen=True)
class Place:
    """Where one class is: an archive by http(s) address or path, or a folder by path."""

    category: str
    synset: str  # empty where the class has an archive or folder of its own
    url: str | None = None
    archive: UPath | None = None
    folder: UPath | None = None

    def __str__(self) -> str:
        return shown(self.url) if self.url else str(self.archive or self.folder)


def find_places(settings: MeshSettings) -> list[Place]:
    """The place of each class, but for those that are generated as no location is given.

    Raises `MissingClassError` for a class that is found nowhere. Over http, where nothing can be
    listed, `<synset>.zip` is taken to exist.
    """
    places = []
    for category, value in sorted(settings.classes.items()):
        _check_names(category, value, settings)
        if is_address(value):
            places.append(_own_place(category, value))
        elif settings.location:
            places.append(_place_at(settings.location, category, value))
    return places


def is_address(value: str) -> bool:
    """Whether a class's value is the address of its own archive or folder, not a synset."""
    return "/" in value or value.endswith(".zip")


def is_http(address: str) -> bool:
    """Whether an address is for `download`, not for fsspec."""
    return address.startswith(("http://", "https://"))


def local_archive(
    place: Place, sha256: str | None, cache: Path, progress: Callable[[str], None]
) -> Path:
    """The archive at `place` as a file on this machine, fetched into `cache` where it must be.

    The token in `HF_TOKEN` opens gated data sets at Hugging Face.
    """
    if place.url:
        try:
            token = os.environ.get("HF_TOKEN")
            return download(place.url, cache, sha256=sha256, token=token, progress=progress)
        except MissingFileError as error:
            raise MissingClassError(
                f"class {place.category!r} is missing: {error}; over http(s) a class is found "
                "as a zip archive only, folders cannot be listed"
            ) from error
    assert place.archive is not None
    path = as_local(place.archive) or copy_object(place.archive, cache, progress)
    verify_sha256(path, sha256, str(place))
    return path


def walk(folder: UPath) -> dict[str, dict]:
    """Every file below `folder`: relative path → length and time or ETag, as fsspec has it.

    Sorted by path. Links are followed, each folder is entered once.
    """
    local = as_local(folder)
    if local is None:
        found = folder.fs.find(folder.path, detail=True)
        start = len(folder.path.rstrip("/")) + 1
        return {path[start:]: info for path, info in sorted(found.items())}
    files, visited = {}, set()
    for here, folders, names in os.walk(local, followlinks=True):
        folders.sort()
        if os.path.realpath(here) in visited:
            folders.clear()
            continue
        visited.add(os.path.realpath(here))
        for name in names:
            path = Path(here, name)
            with contextlib.suppress(OSError):  # a broken link
                state = path.stat()
                info = {"size": state.st_size, "mtime": state.st_mtime_ns}
                files[path.relative_to(local).as_posix()] = info
    return dict(sorted(files.items()))


def source_fingerprint(settings: MeshSettings) -> str:
    """Changes when what the meshes are read from changes; nothing is downloaded.

    Files count by name, length and time or ETag; http archives by the headers of a HEAD
    request. Raises `MissingClassError` where a class is found nowhere, and another `TactileError`
    where a server cannot be asked.
    """
    versions = [
        (category, _version(place))
        for category, value in sorted(settings.classes.items())
        for place in find_places(settings.model_copy(update={"classes": {category: value}}))
    ]
    return content_hash(*versions)


def as_path(address: str) -> UPath:
    """A local path or fsspec URL; raises `TactileError` where its file system is not installed."""
    try:
        path = UPath(address) if "://" in address else UPath(address).expanduser()
        path.fs  # noqa: B018 (made on first use, which is where a missing package shows)
    except (ImportError, ValueError) as error:
        raise TactileError(f"{address} cannot be opened: {one_line(error)}") from error
    return path


def as_local(path: UPath) -> Path | None:
    """`path` as a plain path, if it lies on this machine."""
    return Path(path.path) if path.protocol in ("", "file", "local") else None


def _check_names(category: str, value: str, settings: MeshSettings) -> None:
    for name in (category, category if is_address(value) else value):
        if not re.fullmatch(r"[\w-][\w. -]*", name):
            raise TactileError(
                f"classes: {name!r} cannot name a class or synset: use letters, digits, '_' "
                "and '-' (an archive's address has a '/' or ends in .zip)"
            )
    same = sorted(name for name, other in settings.classes.items() if other == value)
    if len(same) > 1:
        raise TactileError(f"classes: {' and '.join(same)} both stand for {value!r}: keep one")


def _own_place(category: str, value: str) -> Place:
    if is_http(value):
        return Place(category, "", url=value)
    path = as_path(value)
    kind = _kind(path)
    if kind is None:
        raise MissingClassError(
            f"class {category!r}: {value} does not exist: correct it in classes"
        )
    if kind == "folder":
        return Place(category, "", folder=path)
    return Place(category, "", archive=path)


def _place_at(location: str, category: str, synset: str) -> Place:
    if is_http(location):
        parts = urlsplit(location)
        path = f"{parts.path.rstrip('/')}/{synset}.zip"
        return Place(category, synset, url=urlunsplit(parts._replace(path=path)))
    root = as_path(location)
    kind = _kind(root)
    if kind == "file":
        raise TactileError(f"{location} is a file: give the folder that holds {synset}.zip")
    if kind is None:
        raise MissingClassError(
            f"class {category!r} (synset {synset}) is missing: the location {location} does not "
            "exist; correct it, or leave it empty to generate meshes"
        )
    if _kind(root / f"{synset}.zip") == "file":
        return Place(category, synset, archive=root / f"{synset}.zip")
    for name in (synset, category):
        if _kind(root / name) == "folder":
            return Place(category, synset, folder=root / name)
    raise MissingClassError(
        f"class {category!r} (synset {synset}) is missing: {location} holds neither {synset}.zip "
        f"nor {synset}/ nor {category}/; put one there, or take the class out of classes"
    )


def _kind(path: UPath) -> str | None:
    """ "file", "folder", or None where there is nothing."""
    try:
        return "file" if path.is_file() else "folder" if path.is_dir() else None
    except Exception as error:  # every fsspec file system has errors of its own
        raise TactileError(f"{path} cannot be looked at: {one_line(error)}") from error


def _version(place: Place) -> object:
    if place.url:
        return remote_version(place.url, os.environ.get("HF_TOKEN")) or "missing"
    if place.folder is not None:
        return [(name, object_version(info)) for name, info in walk(place.folder).items()]
    assert place.archive is not None
    return object_version(place.archive.fs.info(place.archive.path))
