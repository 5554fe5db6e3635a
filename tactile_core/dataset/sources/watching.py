"""Whether what the meshes are read from has changed; nothing is downloaded for that."""

import os
from typing import NamedTuple

from tactile_core.dataset.sources.cache import object_version
from tactile_core.dataset.sources.download import remote_version
from tactile_core.dataset.sources.folders import walk
from tactile_core.dataset.sources.own_classes import with_classes
from tactile_core.dataset.sources.places import MissingClassError, Place, find_places
from tactile_core.files import content_hash
from tactile_core.settings import MeshSettings


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
