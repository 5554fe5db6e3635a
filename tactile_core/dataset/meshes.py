"""The meshes of all classes under one root, whatever they come from (report, section IV).

`collect_meshes` generates, unpacks or copies them, looks at each, and writes the manifest
that the later stages work from; `load_mesh` gives one back, ready for the camera.
"""

import contextlib
import errno
import logging
from collections.abc import Callable
from functools import partial
from pathlib import Path, PurePosixPath

import pandas as pd
import trimesh
from upath import UPath

from tactile_core.addresses import full, one_line
from tactile_core.dataset.geometry import geometry_hash
from tactile_core.dataset.procedural.models import obj_bytes, procedural_models
from tactile_core.dataset.sources.archives import path_of, read_member, safe_members
from tactile_core.dataset.sources.folders import as_local, as_path, parts_below, read_file, walk
from tactile_core.dataset.sources.layouts import (
    SUFFIXES,
    MeshFile,
    find_models,
    hidden,
    with_unique_ids,
)
from tactile_core.dataset.sources.parsing import parse_mesh
from tactile_core.dataset.sources.places import (
    Place,
    find_places,
    is_address,
    is_http,
    open_place,
    own_folders,
    with_classes,
)
from tactile_core.errors import TactileError, spelt
from tactile_core.files import content_hash, stored_bytes, written_whole
from tactile_core.progress import counted
from tactile_core.settings import MeshSettings

logger = logging.getLogger(__name__)

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
    settings = with_classes(settings)
    _check_apart(settings, root)
    with contextlib.ExitStack() as stack:
        found, sources = _find_meshes(settings, cache / "archives", stack, progress)
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


def _find_meshes(
    settings: MeshSettings,
    cache: Path,
    stack: contextlib.ExitStack,
    progress: Callable[[str], None],
) -> tuple[list[MeshFile], list[dict[str, object]]]:
    """Every mesh, in the manifest's order, and what each place held.

    Archives stay open until `stack` closes.
    """
    places = find_places(settings)
    _check_sums(settings, places)
    meshes = _generated(settings, {place.category for place in places})
    sources = []
    for place in places:
        models, held = _models_at(place, settings, cache, stack, progress)
        meshes += models
        sources.append(held)
    known = {mesh.model_id for mesh in meshes}
    meshes = sorted(with_unique_ids(meshes), key=lambda mesh: (mesh.category, mesh.model_id))
    if renamed := [mesh.model_id for mesh in meshes if mesh.model_id not in known]:
        logger.warning("%d meshes share their names: %s, …", len(renamed), ", ".join(renamed[:3]))
    by_class = {name: [m for m in meshes if m.category == name] for name in settings.named_classes}
    for category, of_class in by_class.items():
        if not of_class:
            raise TactileError(
                f"class {category!r} has no meshes: no location is given, and procedural_models "
                f"says nothing of it; give it a number there (as {category}: 5), or take it out "
                "of classes"
            )
    kept = [m for name in sorted(by_class) for m in by_class[name][: settings.models_per_class]]
    return kept, sources


def _check_sums(settings: MeshSettings, places: list[Place]) -> None:
    """Raises `TactileError` where a checksum is given for what is no archive."""
    found = {place.category: place for place in places}
    for category in settings.sha256:
        if category not in found or found[category].folder is not None:
            what = f"{found[category]} is a folder" if category in found else "it is generated"
            raise TactileError(
                f"sha256 of class {category!r} cannot be looked at, as {what}: give the class's "
                "archive, or take it out of sha256"
            )


def _generated(settings: MeshSettings, elsewhere: set[str]) -> list[MeshFile]:
    classes = {name: s for name, s in settings.named_classes.items() if name not in elsewhere}
    if not classes:
        return []
    models = procedural_models(settings.model_copy(update={"classes": classes}))
    return [
        MeshFile(
            model_id=model_id,
            category=category,
            synset=classes[category],
            source="procedural",
            file=f"{classes[category]}/{model_id}/models/model_normalized.obj",
            path=model_id,
            read=partial(_build, build),
        )
        for category, model_id, build in models
    ]


def _build(build: Callable[[], trimesh.Trimesh]) -> bytes:
    return obj_bytes(build())


def _models_at(
    place: Place,
    settings: MeshSettings,
    cache: Path,
    stack: contextlib.ExitStack,
    progress: Callable[[str], None],
) -> tuple[list[MeshFile], dict[str, object]]:
    """The models at a place, and what was taken and left out there."""
    if place.folder is not None:
        source = "folder"
        files, odd = walk(place.folder)
        readers = {name: partial(read_file, place.folder / name) for name in files}
        readers |= {name: partial(_refuse, why) for name, why in odd.items()}
        everything = [*readers]
    else:
        source = "archive"
        archive = stack.enter_context(
            open_place(place, settings.sha256.get(place.category), cache, progress)
        )
        members = safe_members(archive, SUFFIXES)
        readers = {name: partial(read_member, archive, info) for name, info in members.items()}
        everything = [path_of(member) for member in archive.infolist()]
    try:
        models, left_out = find_models(
            readers, place.category, place.synset, source, everything, place.is_own_folder
        )
    except TactileError as error:
        raise TactileError(f"class {place.category!r}: {place} {error}") from error
    if place.folder is not None:
        models += [_closed(name, why, place) for name, why in odd.items() if name.endswith("/")]
    said = "; ".join(
        f"{len(names)} {why} (as {spelt(names[0])})" for why, names in left_out.items()
    )
    if not models:
        raise TactileError(
            f"class {place.category!r}: {place} holds no mesh; looked for <id>/model.obj, "
            f"<id>/models/model_normalized.obj and *{', *'.join(SUFFIXES)}"
            + (f"; left out: {said}" if said else "")
        )
    progress(f"{place.category}: {len(models)} meshes in {place}")
    if said:
        logger.warning("%s: left out in %s: %s", place.category, place, said)
        progress(f"{place.category}: left out: {said}")
    return models, {
        "category": place.category,
        "source": str(place),
        "taken": len(models),
        "left_out": sum(map(len, left_out.values())),
        "which": said,
    }


def _closed(name: str, why: str, place: Place) -> MeshFile:
    """A folder that is not looked into, set aside as a mesh."""
    path = PurePosixPath(name)
    return MeshFile(
        model_id=path.name or place.category,
        category=place.category,
        synset=place.synset,
        source="folder",
        file=f"{place.synset or place.category}/{path}",
        path="-".join(path.parts),
        read=partial(_refuse, why),
    )


def _refuse(why: str) -> bytes:
    raise TactileError(why)


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
