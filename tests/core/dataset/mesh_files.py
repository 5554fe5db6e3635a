"""Meshes as files: small ones, archives and folders of them, and what came of collecting."""

import zipfile
from pathlib import Path

import pytest
import trimesh
from upath import UPath

from tactile_core.errors import TactileError

MUG, BOTTLE = "03797390", "02876657"
V1, V2 = "model.obj", "models/model_normalized.obj"
ONE = {"mug": MUG}


def obj(size: float = 1.0) -> bytes:
    mesh = trimesh.creation.cylinder(1, size, sections=8)
    return b"mtllib lost.mtl\n" + mesh.export(file_type="obj", header=None).encode()


def make_zip(path: Path, members: dict[str, bytes]) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return path


def make_folder(path: Path, files: dict[str, bytes]) -> Path:
    for name, data in files.items():
        (path / name).parent.mkdir(parents=True, exist_ok=True)
        (path / name).write_bytes(data)
    return path


def refusal(collect, **options) -> str:
    with pytest.raises(TactileError) as caught:
        collect(**options)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def files_under(root: UPath) -> list[str]:
    return sorted(p.relative_to(root).as_posix() for p in Path(root).rglob("*") if p.is_file())
