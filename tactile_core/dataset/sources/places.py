"""Where the meshes of each class lie.

A class is found at the location as `<synset>.zip`, as an extracted `<synset>/`, or as
`<class>/`, a folder of a user's own objects; or it has an archive or a folder of its own.
"""

import os
import re
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import urlsplit, urlunsplit

from upath import UPath

from tactile_core.addresses import full, one_line, shown
from tactile_core.dataset.sources.answers import MissingFileError
from tactile_core.dataset.sources.archives import open_archive
from tactile_core.dataset.sources.cache import copy_object, failure, forget
from tactile_core.dataset.sources.download import download, verify_sha256
from tactile_core.dataset.sources.folders import as_local, as_path
from tactile_core.dataset.sources.layouts import SYNSET
from tactile_core.errors import OutOfReachError, TactileError
from tactile_core.settings import MeshSettings

# Of a class: what stands in paths, tables and messages as it is.
NAME = re.compile(r"[\w(-][\w .,()+&'=@~-]*")


class MissingClassError(OutOfReachError):
    """A class that is found nowhere."""


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
    return address.lower().startswith(("http://", "https://"))


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
    kind = kind_of(path)
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
    kind = kind_of(root)
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
    if kind_of(root / f"{synset}.zip") == "file":
        return Place(category, synset, archive=root / f"{synset}.zip")
    for name in (synset, category):
        if kind_of(root / name) == "folder":
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


def kind_of(path: UPath) -> str | None:
    """ "file", "folder", or None where there is nothing."""
    try:
        return "file" if path.is_file() else "folder" if path.is_dir() else None
    except Exception as error:  # every fsspec file system has errors of its own
        raise failure(error)(f"{shown(str(path))} cannot be looked at: {one_line(error)}") from None
