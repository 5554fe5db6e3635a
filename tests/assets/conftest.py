"""The platform in the smoke profile, run once with the plain command, on a real instance."""

import os

# Read once, when tactile_assets is imported.
os.environ["TACTILE_PROFILE"] = "smoke"
os.environ.pop("TACTILE_SHAPENET", None)
os.environ.pop("TACTILE_REAL", None)

import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import dagster as dg
import pytest

from tests.assets.running import Platform, run_whole_chain
from tests.core.dataset.conftest import make_store, site  # noqa: F401
from tests.shared import once, shared_folder


@pytest.fixture(scope="session")
def no_records(tmp_path_factory) -> Path:
    """Dagster's records before there was a run: to copy them is quicker than to lay them out."""
    folder = tmp_path_factory.mktemp("records")
    with dg.DagsterInstance.from_config(str(folder)):
        return folder


@pytest.fixture
def platform(tmp_path, no_records) -> Iterator[Platform]:
    """An empty home."""
    shutil.copytree(no_records, tmp_path / "dagster")
    with dg.DagsterInstance.from_config(str(tmp_path / "dagster")) as instance:
        yield Platform(tmp_path, instance)


@pytest.fixture(scope="session")
def home(tmp_path_factory) -> Path:
    """Where the finished run lies, whichever test process it was that ran it."""
    home = shared_folder(tmp_path_factory) / "finished"
    home.mkdir(parents=True, exist_ok=True)
    return home


@pytest.fixture(scope="session")
def finished(home, tmp_path_factory) -> subprocess.CompletedProcess:
    """The whole tiny chain, run with the literal command."""
    command = "dagster job execute --job whole_chain"
    return once(tmp_path_factory, "chain", lambda: run_whole_chain(command, home))


@pytest.fixture(scope="session")
def chain(home, finished) -> Iterator[Platform]:
    """What the finished run left behind; not to be changed."""
    with dg.DagsterInstance.from_config(str(home / "dagster")) as instance:
        yield Platform(home, instance)


@pytest.fixture
def copy_of_chain(chain, platform) -> Platform:
    """A home with the artifacts of the finished run, and no history."""
    shutil.copytree(chain.home / "artifacts", platform.home / "artifacts")
    return platform
