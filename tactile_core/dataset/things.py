"""Anything that can be felt out, as a mask: a mesh, a picture, or a generated shape of a class."""

import os
import stat
from pathlib import Path
from typing import NamedTuple

import numpy as np
import trimesh
from upath import UPath

from tactile_core.dataset import drawings
from tactile_core.dataset.drawings import mask_of_picture
from tactile_core.dataset.geometry import geometry_hash
from tactile_core.dataset.procedural.models import GENERATORS
from tactile_core.dataset.rendering.camera import project
from tactile_core.dataset.rendering.rasteriser import rasterise
from tactile_core.dataset.rendering.silhouettes import EMPTY
from tactile_core.dataset.seeds import generator
from tactile_core.dataset.sources.folders import read_file
from tactile_core.dataset.sources.parsing import READERS, parse_mesh
from tactile_core.errors import TactileError


class Thing(NamedTuple):
    """Something to feel out.

    mask : (R, R) bool
    said : what it is and what was done to it, in words
    geometry : of its mesh, see `geometry_hash`; None where it has none
    category : the class that it was generated for; empty where it was not
    """

    mask: np.ndarray
    said: str
    geometry: str | None = None
    category: str = ""


def find_thing(name: str, resolution: int, seed: int = 0) -> Thing:
    """The thing that `name` names: a class that is generated, or the path of a mesh or picture.

    seed : of a generated shape

    Raises `TactileError` where there is no such thing, or it cannot be felt.
    """
    if name in GENERATORS:
        return generated_thing(name, resolution, seed)
    path = Path(os.path.expanduser(name))  # noqa: PTH111 (a file may be called ~cup.obj)
    try:
        mode = path.stat().st_mode
    except (FileNotFoundError, NotADirectoryError, ValueError) as error:  # such as a zero byte
        raise TactileError(
            f"{name} is not there: give a mesh ({' '.join(READERS)}), a picture "
            f"({' '.join(drawings.SUFFIXES)}) or a class that is generated ({' '.join(GENERATORS)})"
        ) from error
    except OSError as error:
        raise TactileError(f"{name} cannot be looked at: {error.strerror}") from error
    if stat.S_ISDIR(mode):
        raise TactileError(f"{name} is a folder: name one mesh or picture in it")
    if not stat.S_ISREG(mode):
        raise TactileError(f"{name} is no file: name a mesh or picture")
    try:
        return thing_in(read_file(UPath(path)), path.suffix, resolution)
    except TactileError as error:
        raise TactileError(f"{name} {error}") from error


def thing_in(data: bytes, suffix: str, resolution: int) -> Thing:
    """The thing in a file's bytes; `suffix`, such as ".obj" or ".png", says what kind it is.

    Raises `TactileError` with the reason, but without a name.
    """
    suffix = suffix.lower()
    if suffix in READERS:
        mesh = parse_mesh(data, suffix)
        return seen(mesh, 0.0, resolution, f"a mesh of {len(mesh.faces)} faces")
    if suffix in drawings.SUFFIXES:
        return Thing(*mask_of_picture(data, resolution))
    raise TactileError(
        f"is neither a mesh ({' '.join(READERS)}) nor a picture ({' '.join(drawings.SUFFIXES)})"
    )


def generated_thing(category: str, resolution: int, seed: int) -> Thing:
    """A generated shape of a class in `GENERATORS`, turned at random.

    No dataset holds it: its random numbers have a name of their own, that no model's have.
    """
    mesh = GENERATORS[category](generator(seed, f"{category} to feel"))
    rotation = float(generator(seed, f"{category} to feel, turned").uniform(0, 360))
    said = f"a generated {category} (seed {seed}), turned by {rotation:.0f}°"
    return seen(mesh, rotation, resolution, said)._replace(category=category)


def seen(mesh: trimesh.Trimesh, rotation: float, resolution: int, said: str) -> Thing:
    """What the report's camera sees of a mesh; raises `TactileError` where that is nothing."""
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    mask = rasterise(project(vertices, rotation, resolution), faces, resolution)
    if not mask.any():
        raise TactileError(f"cannot be seen: {EMPTY}")
    return Thing(mask, said, geometry_hash(vertices, faces))
