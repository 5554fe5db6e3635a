"""Which files of an archive or a folder are models, and what the models are called.

ShapeNetCore v1 lays a model as `<id>/model.obj`, v2 as `<id>/models/model_normalized.obj`,
both under a folder `<synset>/` or none; other meshes in a model's folder are further versions of
the same object. Every other mesh file is a model, and its name is its id.
"""

import itertools
import re
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import PurePosixPath
from typing import NamedTuple

from tactile_core.errors import ODD, TactileError

SUFFIXES = (".obj", ".ply", ".stl", ".off", ".glb")
SHAPENET_FILES = ("model_normalized.obj", "model.obj")  # v2, v1; v2 where a model has both
INNER = ("models", "meshes")  # folders of v2 and of scans between a model and its file
SYNSET = re.compile(r"0[234]\d{6}")  # of all that ShapeNet has; numbered models begin with 00
ARCHIVES = (".zip", ".tar", ".gz", ".tgz", ".bz2", ".xz", ".zst", ".7z", ".rar")
OTHER_FORMATS = (".gltf", ".dae", ".fbx", ".3ds", ".wrl", ".x3d", ".blend", ".step", ".stp",
                 ".usd", ".usda", ".usdc", ".usdz", ".3mf", ".ctm", ".vtk", ".max")  # fmt: skip


@dataclass(frozen=True)
class MeshFile:
    """A mesh that was found, and how to read its bytes.

    file : where it is to lie under the mesh root
    path : the model's folders and name in its source, what a longer model id is made from
    """

    model_id: str
    category: str
    synset: str
    source: str  # "procedural", "archive" or "folder"
    file: str
    path: str
    read: Callable[[], bytes]


class Found(NamedTuple):
    """The models of one class, and the files that were left out: why → their paths."""

    models: list[MeshFile]
    left_out: dict[str, list[str]]


def find_models(
    readers: Mapping[str, Callable[[], bytes]],
    category: str,
    synset: str,
    source: str,
    others: Collection[str] = (),
    own_folder: bool = False,
) -> Found:
    """The models among the files of one class, given as relative path → how to read it.

    others : paths of all files, be they meshes or not, which may tell why there are so few; an
        archive may hold one several times, of which the last is read
    own_folder : whether all files are of the class, whatever their folders are called

    Hidden files are none. Raises `TactileError` where there are several synsets, or another than
    that of the class: none is taken for the class in silence.
    """
    everything = {name: PurePosixPath(name).parts for name in sorted({*readers, *others})}
    everything = {name: parts for name, parts in everything.items() if not hidden(parts)}
    odd = [name for name in everything if ODD.search(name)]
    parts = {
        n: p for n, p in everything.items() if n in readers and _ends(n, SUFFIXES) and n not in odd
    }
    again = [name for name, times in Counter(others).items() for _ in range(1, times)]
    left_out = {
        "archives inside, which are not opened: unpack them": ARCHIVES,
        f"of formats that are not read; those that are: {', '.join(SUFFIXES)}": OTHER_FORMATS,
    }
    found = {why: [n for n in everything if _ends(n, ends)] for why, ends in left_out.items()}
    found["with letters in their names that no line takes: rename them"] = odd
    found["of a name that comes again, and is read where it comes last"] = [
        name for name in again if name in parts
    ]
    own = parts if own_folder else _of_synset(parts, synset)
    if strange := [name for name in parts if name not in own]:
        found["of other synsets"] = strange
    parts = own

    def model(name: str, folders: Iterable[str], model_id: str, file: str) -> MeshFile:
        path = "-".join((*folders, model_id))
        file = f"{synset or category}/{file}"
        return MeshFile(model_id, category, synset, source, file, path, readers[name])

    shapenet: dict[tuple[str, ...], str] = {}
    for shapenet_file in SHAPENET_FILES:
        for name, (*folders, file) in parts.items():
            model_folder = tuple(folders[:-1] if folders[-1:] in ([f] for f in INNER) else folders)
            if model_folder and file == shapenet_file:
                shapenet.setdefault(model_folder, name)
    models = [
        model(name, above, model_id, "/".join(parts[name][len(above) :]))
        for (*above, model_id), name in shapenet.items()
    ]
    further, taken = [], set(shapenet.values())
    for name, path in parts.items():
        if name in taken:
            continue
        if any(path[:depth] in shapenet for depth in range(1, len(path))):
            further.append(name)
            continue
        mesh = PurePosixPath(path[-1])
        models.append(model(name, path[:-1], mesh.stem, f"{mesh.stem}{mesh.suffix.lower()}"))
    found[f"beside the {' or '.join(SHAPENET_FILES)} of a model, taken for the same object"] = (
        further
    )
    return Found(models, {why: names for why, names in found.items() if names})


def with_unique_ids(meshes: Iterable[MeshFile]) -> list[MeshFile]:
    """The same meshes, those that share a model id renamed by class and folder, then by file type,
    then by number.

    Ids are unique over all classes, for samples are known by them from here on.
    """
    renamed = list(meshes)
    for longer in (_id_with_class, _id_with_suffix):
        counts = Counter(mesh.model_id for mesh in renamed)
        renamed = [_renamed(m, longer(m)) if counts[m.model_id] > 1 else m for m in renamed]
    taken = {mesh.model_id for mesh in renamed}
    seen: set[str] = set()
    for place, mesh in enumerate(renamed):
        if mesh.model_id in seen:
            numbers = (f"{mesh.model_id}-{number}" for number in itertools.count(2))
            renamed[place] = _renamed(mesh, next(name for name in numbers if name not in taken))
        seen.add(renamed[place].model_id)
        taken.add(renamed[place].model_id)
    return renamed


def _of_synset(parts: dict[str, tuple[str, ...]], synset: str) -> dict[str, tuple[str, ...]]:
    """The files of one class: path → its parts, below the synset's folder where there is one."""
    own = {n: p[p.index(synset) + 1 :] for n, p in parts.items() if synset in p[:-1]}
    there = sorted(
        {part for path in parts.values() for part in path[:-1] if SYNSET.fullmatch(part)}
    )
    if own or not there:
        return own or parts
    if SYNSET.fullmatch(synset):
        raise TactileError(f"holds {_listed(there)}, and not the synset {synset} of this class")
    if len(there) > 1:
        raise TactileError(
            f"holds several synsets ({_listed(there)}), which are not one class: unpack it, give "
            "the folder of the synsets as location, and the class's synset in classes"
        )
    return parts


def _listed(names: list[str]) -> str:
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


def _ends(name: str, suffixes: tuple[str, ...]) -> bool:
    return name.lower().endswith(suffixes)


def hidden(parts: tuple[str, ...]) -> bool:
    """Whether a path is not for its user: of a folder or file that a system keeps there."""
    return any(part.startswith(".") or part == "__MACOSX" for part in parts)


def _id_with_class(mesh: MeshFile) -> str:
    return f"{mesh.category}-{mesh.path}"


def _id_with_suffix(mesh: MeshFile) -> str:
    return f"{mesh.model_id}-{PurePosixPath(mesh.file).suffix[1:]}"


def _renamed(mesh: MeshFile, model_id: str) -> MeshFile:
    base, name, *below = mesh.file.split("/")
    name = "/".join((model_id, *below)) if below else model_id + PurePosixPath(name).suffix
    return replace(mesh, model_id=model_id, file=f"{base}/{name}")
