"""The meshes of all classes under one root, whatever they come from (report, section IV).

`collect_meshes` generates, unpacks or copies them, looks at each, and lists them in the manifest
that the later stages work from.
"""

import contextlib
import errno
import logging
from collections.abc import Callable
from pathlib import Path, PurePosixPath

import pandas as pd
from upath import UPath

from tactile_core.addresses import full, one_line
from tactile_core.dataset.finding import find_meshes
from tactile_core.dataset.geometry import geometry_hash
from tactile_core.dataset.sources.folders import as_local, as_path, parts_below, walk
from tactile_core.dataset.sources.layouts import (
    SUFFIXES,
    MeshFile,
    hidden,
)
from tactile_core.dataset.sources.own_classes import own_folders, with_classes
from tactile_core.dataset.sources.parsing import parse_mesh
from tactile_core.dataset.sources.places import find_places, is_address, is_http
from tactile_core.errors import TactileError
from tactile_core.files import content_hash, stored_bytes, written_whole
from tactile_core.progress import counted
from tactile_core.settings import MeshSettings

logger = logging.getLogger(__name__)

DOWNLOADS = "archives"  # the folder of a cache that holds them
COLUMNS = {
    "model_id": str,
    "category": str,
    "synset": str,
    "source": str,
    "file": str,
    "vertices": int,
    "faces": int,
    "content_hash": str,
    "geometry": str,
    "status": str,
}


def collect_meshes(
    settings: MeshSettings,
    root: UPath,
    cache: Path,
    progress: Callable[[str], None] = lambda message: None,
) -> pd.DataFrame:
    """Bring the meshes of every class under `root`, and list them.

    root : folder or object store of the meshes; meshes there that are no longer listed are
        removed, those that are there unchanged are not written again
    cache : where downloaded archives are kept

    Returns one row per mesh found, sorted by category and model id: model_id, category,
    synset, source ("procedural", "archive" or "folder"), file (below `root`), vertices,
    faces, content_hash (of the file's bytes), geometry (see `geometry_hash`) and status: "ok", or
    why the mesh is set aside.
    A mesh set aside is not under `root`, and has no vertices and faces; one that could not
    even be read has an empty content_hash. Its attribute "sources" (`DataFrame.attrs`) tells for
    each class that was not generated how many models were taken and files left out, and which.

    Raises `TactileError` where a class is found nowhere, has an archive that is damaged or
    refused, or keeps no usable mesh.
    """
    _check_not_among_them(settings, root)
    settings = with_classes(settings, progress)
    _check_apart(settings, root)
    with contextlib.ExitStack() as stack:
        found, sources = find_meshes(settings, cache / DOWNLOADS, stack, progress)
        present = _present(root)
        rows = [
            _collect(mesh, root, present)
            for mesh in counted(found, len(found), progress, "meshes collected")
        ]
    manifest = pd.DataFrame(rows, columns=list(COLUMNS)).astype(COLUMNS)
    _check_usable(manifest, settings)
    manifest.attrs["sources"] = sources
    for file in sorted(set(present) - set(manifest.loc[manifest["status"] == "ok", "file"])):
        _remove(root, file)
    return manifest


def _collect(mesh: MeshFile, root: UPath, present: dict[str, int]) -> dict[str, object]:
    """Look at one mesh and, if it can be used, see that it lies under `root`."""
    row: dict[str, object] = {name: getattr(mesh, name) for name in COLUMNS if hasattr(mesh, name)}
    row |= {"vertices": 0, "faces": 0, "content_hash": "", "geometry": ""}
    try:
        data = mesh.read()
        row["content_hash"] = content_hash(data)
        checked = parse_mesh(data, PurePosixPath(mesh.file).suffix)
    except TactileError as error:
        logger.warning("%s %s is set aside: it %s", mesh.category, mesh.model_id, error)
        return row | {"status": str(error)}
    try:
        target = root / mesh.file
        if present.get(mesh.file) != len(data) or stored_bytes(target) != data:
            with written_whole(target) as file:
                file.write(data)
    except OSError as error:
        if error.errno != errno.ENAMETOOLONG:  # else there is nowhere for any mesh
            raise TactileError(f"{root} cannot take the meshes: {one_line(error)}") from error
        problem = f"has too long a name for the file system, {PurePosixPath(mesh.file).name[:40]}…"
        logger.warning("%s %s is set aside: it %s", mesh.category, mesh.model_id, problem)
        return row | {"status": f"{problem}: rename it"}
    return row | {
        "vertices": len(checked.vertices),
        "faces": len(checked.faces),
        "geometry": geometry_hash(checked.vertices, checked.faces),
        "status": "ok",
    }


def _check_usable(manifest: pd.DataFrame, settings: MeshSettings) -> None:
    for category in sorted(settings.named_classes):
        rows = manifest[manifest["category"] == category]
        if not (rows["status"] == "ok").any():
            first = rows.iloc[0]
            raise TactileError(
                f"class {category!r}: none of its {len(rows)} meshes can be used (the first, "
                f"{first['model_id']}, {first['status']}): look at the source"
            )


def _check_apart(settings: MeshSettings, root: UPath) -> None:
    """The meshes under `root` come and go, so no source of meshes may lie there."""
    own = [value for value in settings.named_classes.values() if is_address(value)]
    for setting in own + ([settings.location] if settings.location else []):
        address = full(setting)
        local_root = as_local(root)
        source = None if is_http(address) else as_local(as_path(address))
        if local_root and source and source.resolve().is_relative_to(local_root.resolve()):
            raise TactileError(f"{setting} lies where meshes are stored ({root}): move it away")


def _check_not_among_them(settings: MeshSettings, root: UPath) -> None:
    """Meshes that are stored in a folder of meshes would be found there by the next run."""
    folders = [place.folder for place in find_places(with_classes(settings)) if place.folder]
    if settings.classes is None and settings.location and own_folders(full(settings.location)):
        folders.append(as_path(full(settings.location)))
    for folder in folders:
        between = parts_below(root, folder)
        if between is not None and not hidden(between):
            raise TactileError(
                f"{root}, where meshes are stored, lies among the meshes of {folder}: let "
                "TACTILE_STORE name another folder, or TACTILE_HOME where that is not set"
            )


def _present(root: UPath) -> dict[str, int]:
    """Mesh files that lie under `root` already: path → length in bytes."""
    if not root.exists():
        return {}
    sizes = {file: int(info["size"]) for file, info in walk(root).files.items()}
    return {file: size for file, size in sizes.items() if file.lower().endswith(SUFFIXES)}


def _remove(root: UPath, file: str) -> None:
    """Remove a mesh that is no longer listed, and the folders that it leaves empty."""
    path = root / file
    path.fs.rm_file(path.path)  # `unlink` takes brackets in a name of an object for a pattern
    local = as_local(root)
    if local is not None:
        with contextlib.suppress(OSError):  # not empty
            for folder in PurePosixPath(file).parents[:-1]:
                (local / folder).rmdir()
