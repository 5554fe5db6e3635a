"""From a mesh file's bytes to a mesh that the camera can take, or the reason why not."""

import numpy as np
import trimesh
from upath import UPath

from tactile_core.addresses import one_line
from tactile_core.dataset.sources.archives import MAX_FILE
from tactile_core.dataset.sources.glb import read_glb
from tactile_core.dataset.sources.obj import read_obj
from tactile_core.dataset.sources.off import read_off
from tactile_core.dataset.sources.ply import read_ply
from tactile_core.dataset.sources.sightings import without_unseen
from tactile_core.dataset.sources.stl import read_stl
from tactile_core.dataset.sources.strangers import stranger
from tactile_core.errors import DamagedError, TactileError
from tactile_core.files import content_hash, stored_bytes

# Of the farthest coordinate: a mesh that is no larger is what rounding has left of one.
ROUNDED = 1e-13
READERS = {".obj": read_obj, ".ply": read_ply, ".stl": read_stl, ".off": read_off, ".glb": read_glb}


def parse_mesh(data: bytes, suffix: str) -> trimesh.Trimesh:
    """A mesh file's bytes as a mesh centred on its bounding box, with a diagonal of 1.

    Only vertices that belong to a face are kept, and faces that can draw no pixel are left out
    where they alone would decide size and place. Raises `TactileError` with the reason, but
    without a name, where the mesh is unreadable, cut off or empty, has a face with a vertex
    that is not finite or not there, or no extent; never another exception.
    """
    suffix = suffix.lower()
    if len(data) > MAX_FILE:
        raise TactileError(
            f"has {len(data) >> 20} MiB, more than the {MAX_FILE >> 20} that are read"
        )
    if suffix not in READERS:
        raise TactileError(f"is none of the kinds that are read: {', '.join(READERS)}")
    try:
        if kind := stranger(data, suffix):
            raise TactileError(kind)
        return _normalised(*READERS[suffix](data))
    except TactileError:
        raise
    except Exception as error:  # broken files fail in more ways than anyone lists, memory too
        raise TactileError(f"cannot be read as {suffix[1:].upper()} ({one_line(error)})") from error


def load_mesh(root: UPath, file: str, version: str | None = None) -> trimesh.Trimesh:
    """The mesh at `file` below `root`, centred on its bounding box and scaled to diagonal 1.

    version : the content hash that the manifest holds; None: whatever is there

    Materials are not loaded. Raises `DamagedError` where the file is missing or has changed since
    it was collected, `OutOfReachError` where its store does not answer, and `TactileError` where
    the mesh cannot be used.
    """
    path = root / file
    try:
        data = stored_bytes(path)
    except FileNotFoundError as error:
        raise DamagedError(f"{path} is missing: materialise shapenet_meshes again") from error
    except OSError as error:
        raise DamagedError(f"{path} cannot be read ({one_line(error)})") from error
    if version is not None and content_hash(data) != version:
        raise DamagedError(
            f"{path} has changed since it was collected: materialise shapenet_meshes again"
        )
    try:
        return parse_mesh(data, path.suffix)
    except TactileError as error:
        raise TactileError(f"{path} {error}: materialise shapenet_meshes again") from error


def _normalised(vertices: np.ndarray, faces: np.ndarray) -> trimesh.Trimesh:
    """Vertices (V, 3) and triangles (F, 3) as a mesh of diagonal 1 about the origin."""
    if not len(faces):
        raise TactileError("has no faces")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise TactileError(f"has a face with a vertex that does not exist (of {len(vertices)})")
    vertices, faces = _used(vertices, faces)
    if not np.isfinite(vertices).all():
        raise TactileError("has a vertex that is not a finite number")
    with np.errstate(over="ignore"):
        diagonal = np.linalg.norm(np.ptp(vertices, axis=0))
    if not diagonal < np.inf:
        raise TactileError("is too large to measure")
    if diagonal <= ROUNDED * np.abs(vertices).max():
        raise TactileError("has no extent")
    vertices, faces = _used(vertices, without_unseen(vertices, faces))
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    vertices = (vertices - (low + high) / 2) / np.linalg.norm(high - low)
    return trimesh.Trimesh(vertices, faces, process=False)


def _used(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The vertices that belong to a face, in their order, and the faces in their numbers."""
    used = np.zeros(len(vertices), dtype=bool)
    used[faces] = True
    if used.all():
        return vertices, faces
    return vertices[used], (np.cumsum(used) - 1)[faces]
