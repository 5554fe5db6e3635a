"""From a mesh file's bytes to a mesh that the camera can take, or the reason why not."""

import io
import re

import numpy as np
import trimesh
from upath import UPath

from tactile_core.dataset.sources.archives import one_line
from tactile_core.dataset.sources.obj import read_obj
from tactile_core.errors import TactileError

FACES_ANNOUNCED = {
    ".ply": rb"element\s+face\s+(\d+)",
    ".off": rb"OFF\s+(?:#[^\n]*\n\s*)*\d+\s+(\d+)",
}


def parse_mesh(data: bytes, suffix: str) -> trimesh.Trimesh:
    """A mesh file's bytes as a mesh centred on its bounding box, with a diagonal of 1.

    Only vertices that belong to a face are kept. Raises `TactileError` with the reason, but
    without a name, where the mesh is unreadable or empty, has a vertex that is not finite, a
    face without its vertex, or no extent.
    """
    vertices, faces = _read(data, suffix.lower())
    if not len(faces):
        raise TactileError("has no faces")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise TactileError(f"has a face with a vertex that does not exist (of {len(vertices)})")
    if not np.isfinite(vertices).all():
        raise TactileError("has a vertex that is not a finite number")
    used = np.zeros(len(vertices), dtype=bool)
    used[faces] = True
    if not used.all():
        vertices, faces = vertices[used], (np.cumsum(used) - 1)[faces]
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    with np.errstate(over="ignore"):
        diagonal = np.linalg.norm(high - low)
    if not 0 < diagonal < np.inf:
        raise TactileError("has no extent" if diagonal == 0 else "is too large to measure")
    vertices = (vertices - (low + high) / 2) / diagonal
    return trimesh.Trimesh(vertices, faces, process=False)


def load_mesh(root: UPath, file: str) -> trimesh.Trimesh:
    """The mesh at `file` below `root`, centred on its bounding box and scaled to diagonal 1.

    Materials are not loaded. Raises `TactileError` where the mesh cannot be used.
    """
    path = root / file
    try:
        return parse_mesh(path.read_bytes(), path.suffix)
    except FileNotFoundError as error:
        raise TactileError(f"{path} is missing: materialise shapenet_meshes again") from error
    except TactileError as error:
        raise TactileError(f"{path} {error}: materialise shapenet_meshes again") from error


def _read(data: bytes, suffix: str) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) and triangles (F, 3)."""
    if suffix == ".obj":
        return read_obj(data)
    try:
        mesh = trimesh.load_mesh(io.BytesIO(data), file_type=suffix[1:], process=False)
        vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    except Exception as error:  # each of trimesh's readers fails in its own ways
        raise TactileError(f"cannot be read as {suffix[1:].upper()} ({one_line(error)})") from error
    # trimesh reads a PLY or OFF text that is cut off as far as it goes.
    announced = re.search(FACES_ANNOUNCED.get(suffix, rb"(?!)"), data[:4096])
    if announced and len(faces) < int(announced[1]):
        raise TactileError(f"has fewer faces than the {int(announced[1])} it announces")
    return vertices, faces
