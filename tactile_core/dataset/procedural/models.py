"""Generated meshes for the classes of the report (section IV), where ShapeNet is not at hand.

Model k of a class depends on the seed, the class and k alone, so a longer list of models
begins with the shorter one.
"""

import hashlib
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
import trimesh

from tactile_core.dataset.procedural.bottles import bottle
from tactile_core.dataset.procedural.mugs import mug
from tactile_core.dataset.seeds import generator
from tactile_core.errors import TactileError
from tactile_core.settings import MeshSettings

GENERATORS: dict[str, Callable[[np.random.Generator], trimesh.Trimesh]] = {
    "mug": mug,
    "bottle": bottle,
}


def procedural_models(
    settings: MeshSettings,
) -> Iterator[tuple[str, str, Callable[[], trimesh.Trimesh]]]:
    """(category, model_id, function that builds the mesh) of every model that `settings` asks for.

    Meshes are watertight bodies side by side, +Y up, centred on their bounding box, with a
    bounding-box diagonal of 1 and mug handles towards +X. Raises `TactileError`, before the
    first model, where a class has no generator.
    """
    unknown = sorted({*settings.named_classes, *settings.procedural_models} - set(GENERATORS))
    if unknown:
        raise TactileError(
            f"procedural_models: no generator for class {unknown[0]!r}; known are "
            f"{', '.join(GENERATORS)} (for any other class, set `location` to its meshes)"
        )
    return (
        (category, _model_id(settings.seed, name), partial(_build, category, settings.seed, name))
        for category in settings.named_classes
        for name in (f"{category} {k}" for k in range(settings.procedural_models.get(category, 0)))
    )


def obj_bytes(mesh: trimesh.Trimesh) -> bytes:
    """`mesh` as a Wavefront OBJ; coordinates keep six decimals, so bytes repeat."""
    vertices = mesh.vertices.round(6) + 0.0  # no negative zeros
    faces = mesh.faces + 1
    text = ("v %.6f %.6f %.6f\n" * len(vertices)) % tuple(vertices.ravel().tolist())
    text += ("f %d %d %d\n" * len(faces)) % tuple(faces.ravel().tolist())
    return text.encode()


def _build(category: str, seed: int, name: str) -> trimesh.Trimesh:
    return GENERATORS[category](generator(seed, name))


def _model_id(seed: int, name: str) -> str:
    """32 hex digits, as ShapeNet's ids."""
    return hashlib.sha256(f"procedural {name}, seed {seed}".encode()).hexdigest()[:32]
