"""Every mesh that the settings ask for, before it is looked at: generated, unpacked or as it is."""

import contextlib
import logging
from collections.abc import Callable
from functools import partial
from pathlib import Path, PurePosixPath

import trimesh

from tactile_core.dataset.procedural.models import obj_bytes, procedural_models
from tactile_core.dataset.sources.archives import path_of, read_member, safe_members
from tactile_core.dataset.sources.folders import read_file, walk
from tactile_core.dataset.sources.layouts import SUFFIXES, MeshFile, find_models, with_unique_ids
from tactile_core.dataset.sources.places import Place, find_places, open_place
from tactile_core.errors import TactileError, spelt
from tactile_core.settings import MeshSettings

logger = logging.getLogger(__name__)


def find_meshes(
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
    most = settings.models_per_class
    for name, of_class in by_class.items():
        if most is not None and len(of_class) > most:
            progress(f"{name}: the first {most} of {len(of_class)} are taken (models_per_class)")
    return [m for name in sorted(by_class) for m in by_class[name][:most]], sources


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
