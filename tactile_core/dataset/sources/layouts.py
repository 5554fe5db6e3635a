"""Which files of an archive or a folder are models, and what the models are called.

ShapeNetCore v1 lays a model as `<id>/model.obj`, v2 as `<id>/models/model_normalized.obj`,
both under a folder `<synset>/` or none. In any other folder or archive each mesh file is a
model, and its name is its id.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import PurePosixPath

from tactile_core.errors import TactileError

SUFFIXES = (".obj", ".ply", ".stl", ".off", ".glb")
SHAPENET_FILES = ("model_normalized.obj", "model.obj")  # v2, v1; v2 where a model has both


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


def find_models(
    readers: Mapping[str, Callable[[], bytes]], category: str, synset: str, source: str
) -> list[MeshFile]:
    """The models among the files of one class, given as relative path → how to read it.

    Hidden files are none. Where any file lies as ShapeNet lays them, only such are models.
    """
    parts = {name: PurePosixPath(name).parts for name in sorted(readers)}
    parts = {n: p for n, p in parts.items() if p[-1].lower().endswith(SUFFIXES) and not _hidden(p)}
    # An archive of several synsets serves each class with its own.
    parts = {n: p[p.index(synset) + 1 :] for n, p in parts.items() if synset in p[:-1]} or parts

    def model(name: str, folders: Iterable[str], model_id: str, file: str) -> MeshFile:
        path = "-".join((*folders, model_id))
        file = f"{synset or category}/{file}"
        return MeshFile(model_id, category, synset, source, file, path, readers[name])

    shapenet: dict[tuple[str, ...], str] = {}
    for shapenet_file in SHAPENET_FILES:
        for name, (*folders, file) in parts.items():
            model_folder = tuple(folders[:-1] if folders[-1:] == ["models"] else folders)
            if model_folder and file == shapenet_file:
                shapenet.setdefault(model_folder, name)
    if shapenet:
        return [
            model(name, above, model_id, "/".join(parts[name][len(above) :]))
            for (*above, model_id), name in shapenet.items()
        ]
    names = {name: PurePosixPath(path[-1]) for name, path in parts.items()}
    return [
        model(n, parts[n][:-1], file.stem, f"{file.stem}{file.suffix.lower()}")
        for n, file in names.items()
    ]


def with_unique_ids(meshes: Iterable[MeshFile]) -> list[MeshFile]:
    """The same meshes, those that share a model id renamed by class and folder, then file type.

    Ids are unique over all classes, for samples are known by them from here on. Raises
    `TactileError` where two meshes still share one.
    """
    renamed = list(meshes)
    for longer in (_id_with_class, _id_with_suffix):
        counts = Counter(mesh.model_id for mesh in renamed)
        renamed = [_renamed(m, longer(m)) if counts[m.model_id] > 1 else m for m in renamed]
    counts = Counter(mesh.model_id for mesh in renamed)
    if shared := sorted(model_id for model_id, count in counts.items() if count > 1):
        raise TactileError(
            f"{counts[shared[0]]} meshes would all be called {shared[0]!r}: rename their files"
        )
    return renamed


def _hidden(parts: tuple[str, ...]) -> bool:
    return any(part.startswith(".") or part == "__MACOSX" for part in parts)


def _id_with_class(mesh: MeshFile) -> str:
    return f"{mesh.category}-{mesh.path}"


def _id_with_suffix(mesh: MeshFile) -> str:
    return f"{mesh.model_id}-{PurePosixPath(mesh.file).suffix[1:]}"


def _renamed(mesh: MeshFile, model_id: str) -> MeshFile:
    base, name, *below = mesh.file.split("/")
    name = "/".join((model_id, *below)) if below else model_id + PurePosixPath(name).suffix
    return replace(mesh, model_id=model_id, file=f"{base}/{name}")
