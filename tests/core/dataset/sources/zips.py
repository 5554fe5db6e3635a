"""Zip archives for tests, and how they are read and refused."""

import zipfile
from pathlib import Path

import pytest

from tactile_core.dataset.sources.archives import open_archive, read_member, safe_members
from tactile_core.errors import TactileError

GOOD = "03797390/a/model.obj"


def make_zip(path: Path, members: dict[str, bytes]) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return path


def read(archive: zipfile.ZipFile, name: str) -> bytes:
    return read_member(archive, archive.getinfo(name))


def refusal(path: Path) -> str:
    """The message with which the archive must be refused: one line that names it."""
    with pytest.raises(TactileError) as caught, open_archive(path) as archive:
        safe_members(archive, [".obj"])
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
    return str(caught.value)
