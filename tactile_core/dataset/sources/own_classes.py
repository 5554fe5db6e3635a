"""A user's own folders of meshes: each is a class, and need not be named anywhere."""

from collections.abc import Callable, Iterable
from pathlib import PurePosixPath

from upath import UPath

from tactile_core.addresses import full, shown
from tactile_core.dataset.sources.folders import OUT, as_local, as_path, walk
from tactile_core.dataset.sources.layouts import ARCHIVES, OTHER_FORMATS, SUFFIXES, SYNSET, hidden
from tactile_core.dataset.sources.places import is_address, is_http, kind_of
from tactile_core.errors import TactileError
from tactile_core.settings import SHAPENET_CLASSES, MeshSettings

NO_CLASSES = {"lost+found"}  # which every disk has, for its administrator alone


def with_classes(
    settings: MeshSettings, say: Callable[[str], object] = lambda sentence: None
) -> MeshSettings:
    """The same settings with `classes`: those that they name, or else the report's two.

    Where none are named and the location is a folder without the two synsets, every folder in it
    that holds meshes is a class, or the location itself where meshes lie in it loose. `say` is told
    of folders that are none of these.
    """
    if settings.classes is not None:
        return settings
    found = own_classes(settings.location, say) if settings.location else {}
    return settings.model_copy(update={"classes": found or SHAPENET_CLASSES})


def own_classes(
    location: str, say: Callable[[str], object] = lambda sentence: None
) -> dict[str, str]:
    """The classes that a user's own folders are; none where there is nothing to be listed.

    Raises `TactileError` where the location, or a folder in it, cannot be read: without a word a
    class would be missing.
    """
    address = full(location)
    if not own_folders(address):
        if not is_http(address) and (beside := folders_beside_synsets(as_path(address))):
            say(
                f"{shown(location)} is taken for ShapeNet; what else lies there "
                f"({', '.join(beside[:3])}) is looked at only where classes name it"
            )
        return {}
    root = as_path(address)
    files, left_out = walk(root)
    meshes = _meshes_in(files)
    folders = sorted({parts[0] for parts in meshes if len(parts) > 1})
    if loose := [parts[0] for parts in meshes if len(parts) == 1]:
        if folders:
            say(
                f"{shown(location)} is taken for one class, as meshes lie in it loose (as "
                f"{loose[0]}): its folders ({', '.join(folders)}) are classes of their own only "
                "without these"
            )
        return {_name_of(root): location if is_address(location) else f"./{location}"}
    names = set(folders)
    for name, why in left_out.items():
        if (folder := _may_be_class(name)) is None:
            continue
        place = root / folder
        if why != OUT:
            raise TactileError(f"{shown(str(place))} {why}: make it readable, or move it away")
        if _meshes_in(walk(place).files):  # a link that is a class, as if it had been named
            names.add(folder)
    unread = {parts[0]: "/".join(parts) for parts in _ending(files, OTHER_FORMATS + ARCHIVES)}
    if names and (none := [path for name, path in unread.items() if name not in names]):
        say(
            f"{len(none)} of what lies in {shown(location)} are no classes (as {none[0]}): meshes "
            f"are {', '.join(SUFFIXES)}"
        )
    return {name: SHAPENET_CLASSES.get(name, name) for name in sorted(names)}


def _meshes_in(files: Iterable[str]) -> list[tuple[str, ...]]:
    """The parts of each path that is a mesh's."""
    return _ending(files, SUFFIXES)


def _ending(files: Iterable[str], suffixes: tuple[str, ...]) -> list[tuple[str, ...]]:
    every = (PurePosixPath(name).parts for name in files)
    return [p for p in every if p[-1].lower().endswith(suffixes) and not hidden(p)]


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
    if is_http(address) or kind_of(root := as_path(address)) != "folder":
        return False
    synsets = SHAPENET_CLASSES.values()
    return not any(kind_of(root / n) for synset in synsets for n in (synset, f"{synset}.zip"))


def folders_beside_synsets(root: UPath) -> list[str]:
    """The folders of ShapeNet's location that are no synset, nor called as a class of the report;
    none where the location cannot be listed, as a bucket whose objects alone may be read."""
    try:
        names = sorted(path.name for path in root.iterdir() if path.is_dir())
    except Exception:  # every fsspec file system has errors of its own
        return []
    known = {*SHAPENET_CLASSES, *NO_CLASSES}
    return [n for n in names if not (SYNSET.fullmatch(n) or n in known or hidden((n,)))]


def _name_of(root: UPath) -> str:
    """What a folder of loose meshes is called, as a class."""
    local = as_local(root)
    path = str(local.resolve()) if local is not None else root.path
    return path.rstrip("/").rpartition("/")[2] or "meshes"
