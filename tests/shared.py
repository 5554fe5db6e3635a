"""Fixtures that take long to make are made once, whatever the number of test processes."""

import os
import pickle
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from filelock import FileLock

ELSEWHERE = "TACTILE_TESTS_SHARED"  # names a folder that several runs of pytest may share


def shared_folder(factory: pytest.TempPathFactory) -> Path:
    """A folder that all processes of this run see; each removes nothing from it."""
    if ELSEWHERE in os.environ:
        return Path(os.environ[ELSEWHERE])
    own = factory.getbasetemp()
    # The processes of pytest-xdist have folders of their own inside that of the run.
    return own.parent if "PYTEST_XDIST_WORKER" in os.environ else own


def copied(home: Path | str, copy: Path, symlinks: bool = False) -> Path:
    """A copy of a home that others read meanwhile: what SQLite keeps beside a database goes when
    the last of them closes it, be it while it is copied. Then it is copied again."""
    for _ in range(10):
        try:
            return Path(shutil.copytree(home, copy, symlinks=symlinks))
        except shutil.Error:
            shutil.rmtree(copy)
    return Path(shutil.copytree(home, copy, symlinks=symlinks))


def once(factory: pytest.TempPathFactory, name: str, make: Callable[[], Any]) -> Any:
    """What `make` returns: it is called by whoever comes first, the others read what that made."""
    file = shared_folder(factory) / f"{name}.pickle"
    file.parent.mkdir(parents=True, exist_ok=True)
    with FileLock(f"{file}.lock"):
        if not file.exists():
            made = pickle.dumps(make())
            file.write_bytes(made)
    return pickle.loads(file.read_bytes())
