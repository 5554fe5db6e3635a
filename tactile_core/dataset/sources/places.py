"""Where the meshes of each class lie, and whether they have changed.

A class is found at the location as `<synset>.zip`, as an extracted `<synset>/`, or as
`<class>/`, a folder of a user's own objects; or it has an archive or a folder of its own. A user's
own folders need not be named anywhere: each is a class.
"""

import os
import re
import zipfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import NamedTuple
from urllib.parse import urlsplit, urlunsplit

from upath import UPath

from tactile_core.addresses import full, one_line, shown
from tactile_core.dataset.sources.answers import MissingFileError
from tactile_core.dataset.sources.archives import open_archive
from tactile_core.dataset.sources.cache import copy_object, failure, forget, object_version
from tactile_core.dataset.sources.download import download, remote_version, verify_sha256
from tactile_core.dataset.sources.folders import OUT, as_local, as_path, walk
from tactile_core.dataset.sources.layouts import SUFFIXES, SYNSET, hidden
from tactile_core.errors import OutOfReachError, TactileError
from tactile_core.files import content_hash
from tactile_core.settings import SHAPENET_CLASSES, MeshSettings

NO_CLASSES = {"lost+found"}  # which every disk has, for its administrator alone
# Of a class: what stands in paths, tables and messages as it is.
NAME = re.compile(r"[\w(-][\w .,()+&'=@~-]*")


class MissingClassError(OutOfReachError):
    """A class that is found nowhere."""


def with_classes(settings: MeshSettings) -> MeshSettings:
    """The same settings with `classes`: those that they name, or else the report's two.

    Where none are named and the location is a folder without the two synsets, every folder in it
    that holds meshes is a class, or the location itself where meshes lie in it loose.
    """
    if settings.classes is not None:
        return settings
    found = own_classes(settings.location) if settings.location else {}
    return settings.model_copy(update={"classes": found or SHAPENET_CLASSES})


def own_classes(location: str) -> dict[str, str]:
    """The classes that a user's own folders are; none where there is nothing to be listed.

    Raises `TactileError` where the location, or a folder in it, cannot be read: without a word a
    class would be missing.
    """
    address = full(location)
    if not own_folders(address):
        return {}
    root = as_path(address)
    files, left_out = walk(root)
    meshes = _meshes_in(files)
    if any(len(parts) == 1 for parts in meshes):
        return {_name_of(root): location if is_address(location) else f"./{location}"}
    names = {parts[0] for parts in meshes}
    for name, why in left_out.items():
        if (folder := _may_be_class(name)) is None:
            continue
        place = root / folder
        if why != OUT:
            raise TactileError(f"{shown(str(place))} {why}: make it readable, or move it away")
        if _meshes_in(walk(place).files):  # a link that is a class, as if it had been named
            names.add(folder)
    return {name: SHAPENET_CLASSES.get(name, name) for name in sorted(names)}


def _meshes_in(files: Iterable[str]) -> list[tuple[str, ...]]:
    """The parts of each path that is a mesh's."""
    every = (PurePosixPath(name).parts for name in files)
    return [p for p in every if p[-1].lower().endswith(SUFFIXES) and not hidden(p)]


def _may_be_class(left_out: str) -> str | None:
    """The name of a folder in a location that was left out, "" for the location itself; None for
    what lies deeper, is hidden, or is no folder."""
    folder, slash, below = left_out.partition("/")
    if not slash or below or folder in NO_CLASSES:
        return None
    return "" if folder == "." else None if hidden((folder,)) else folder


def own_folders(address: str) -> bool:
    """Whether a location's folders are looked at for classes that nobody named: not over http, and
    not ShapeNet itself, whose million files are not to be listed."""
    if is_http(address) or _kind(root := as_path(address)) != "folder":
        return False
    synsets = SHAPENET_CLASSES.values()
    return not any(_kind(root / n) for synset in synsets for n in (synset, f"{synset}.zip"))


def _name_of(root: UPath) -> str:
    """What a folder of loose meshes is called, as a class."""
    local = as_local(root)
    path = str(local.resolve()) if local is not None else root.path
    return path.rstrip("/").rpartition("/")[2] or "meshes"


@dataclass(frozen=True)
class Place:
    """Where one class is: an archive by http(s) address or path, or a folder by path."""

    category: str
    synset: str  # empty where the class has an archive or folder of its own
    # Not for messages: an address may hold a secret.
    url: str | None = field(default=None, repr=False)
    archive: UPath | None = field(default=None, repr=False)
    folder: UPath | None = field(default=None, repr=False)

    @property
    def is_own_folder(self) -> bool:
        """Whether it is a folder called as the class, with whatever folders its user made."""
        if self.folder is None or not self.synset:
            return False
        return not SYNSET.fullmatch(self.folder.name)

    def __str__(self) -> str:
        return shown(self.url or str(self.archive or self.folder))


def find_places(settings: MeshSettings) -> list[Place]:
    """The place of each class, but for those that are generated as no location is given.

    Raises `MissingClassError` for a class that is found nowhere. Over http, where nothing can be
    listed, `<synset>.zip` is taken to exist.
    """
    places = []
    for category, value in sorted(settings.named_classes.items()):
        _check_names(category, value)
        if is_address(value):
            places.append(_own_place(category, full(value)))
        elif settings.location:
            places.append(_place_at(full(settings.location), category, value))
    return places


def is_address(value: str) -> bool:
    """Whether a class's value is the address of its own archive or folder, not a synset.

    An address that is not to be seen is given as `$NAME`, the variable that holds it.
    """
    return "/" in value or value.endswith(".zip") or value.startswith("$")


def is_http(address: str) -> bool:
    """Whether an address is for `download`, not for fsspec."""
    return address.startswith(("http://", "https://"))


def open_place(
    place: Place, sha256: str | None, cache: Path, progress: Callable[[str], None]
) -> zipfile.ZipFile:
    """The archive at `place`, fetched into `cache` where it lies elsewhere.

    What was fetched and is no archive leaves the cache again, so that the next run asks anew.
    """
    path = _local_archive(place, sha256, cache, progress)
    try:
        return open_archive(path, str(place))
    except TactileError:
        if place.url or (place.archive is not None and as_local(place.archive) is None):
            forget(path)
        raise


def _local_archive(
    place: Place, sha256: str | None, cache: Path, progress: Callable[[str], None]
) -> Path:
    """The archive at `place` as a file on this machine.

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


class Fingerprint(NamedTuple):
    """By class what changes when its source does, and why some classes cannot be watched."""

    versions: dict[str, str]
    unwatched: tuple[str, ...]


def source_fingerprint(settings: MeshSettings) -> Fingerprint:
    """The versions of what the meshes are read from; nothing is downloaded.

    Files count by name, length and time or ETag; http archives by the headers of a HEAD
    request. Raises `MissingClassError` where a class is found nowhere or nothing is in its place,
    and another `TactileError` where a server cannot be asked.
    """
    versions = {}
    unwatched = []
    for category, value in sorted(with_classes(settings).named_classes.items()):
        for place in find_places(settings.model_copy(update={"classes": {category: value}})):
            version = _version(place)
            if version is not None:
                versions[category] = content_hash(version)
            else:
                unwatched.append(
                    f"{place} is not watched: its server tells neither an ETag nor a time"
                )
    return Fingerprint(versions, tuple(unwatched))


def _check_names(category: str, value: str) -> None:
    for name in (category, category if is_address(value) else value):
        if not NAME.fullmatch(name):
            raise TactileError(
                f"{shown(name)!r} cannot name a class or synset, nor its folder: use "
                "letters, digits, '_' and '-' (an archive's address has a '/' or ends in .zip)"
            )


def _own_place(category: str, value: str) -> Place:
    if is_http(value):
        return Place(category, "", url=value)
    path = as_path(value)
    kind = _kind(path)
    if kind is None:
        raise MissingClassError(
            f"class {category!r}: {shown(value)} does not exist: correct it in classes"
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
        raise TactileError(
            f"{shown(location)} is a file: give the folder that holds {synset}.zip, or unpack "
            f"an archive of all synsets and give the folder that holds {synset}/"
        )
    if kind is None:
        raise MissingClassError(
            f"class {category!r} (synset {synset}) is missing: the location {shown(location)} does "
            "not exist; correct it, or leave it empty to generate meshes"
        )
    if _kind(root / f"{synset}.zip") == "file":
        return Place(category, synset, archive=root / f"{synset}.zip")
    for name in (synset, category):
        if _kind(root / name) == "folder":
            return Place(category, synset, folder=root / name)
    advice = "put one there, or take the class out of classes"
    if others := _other_archives(root, synset, category):
        advice = f"unpack {' or '.join(others)} as {synset}/"
    raise MissingClassError(
        f"class {category!r} (synset {synset}) is missing: {shown(location)} holds neither "
        f"{synset}.zip nor {synset}/ nor {category}/; {advice}"
    )


def _other_archives(root: UPath, *names: str) -> list[str]:
    """Up to three files in `root` that are called as a class is, as `02876657.tar.gz`."""
    starts = tuple(f"{name}." for name in names)
    try:
        found = sorted(path.name for path in root.iterdir() if path.name.startswith(starts))
    except Exception as error:  # every fsspec file system has errors of its own
        raise failure(error)(f"{shown(str(root))} cannot be listed: {one_line(error)}") from None
    return found[:3]


def _kind(path: UPath) -> str | None:
    """ "file", "folder", or None where there is nothing."""
    try:
        return "file" if path.is_file() else "folder" if path.is_dir() else None
    except Exception as error:  # every fsspec file system has errors of its own
        raise failure(error)(f"{shown(str(path))} cannot be looked at: {one_line(error)}") from None


def _version(place: Place) -> object:
    """What changes when the place does; None where its server does not tell."""
    if place.url:
        version = remote_version(place.url, os.environ.get("HF_TOKEN"))
        if version is None:
            raise MissingClassError(f"class {place.category!r} is missing: {place} is not there")
        return version or None
    if place.folder is not None:
        files = walk(place.folder).files
        if not files:  # as a disk that is not mounted
            raise MissingClassError(f"class {place.category!r} is missing: {place} is empty")
        versions = [(name, object_version(info)) for name, info in files.items()]
        return None if any(version is None for _, version in versions) else versions
    assert place.archive is not None
    return object_version(place.archive.fs.info(place.archive.path))
