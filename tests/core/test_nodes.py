"""A node that lacks the package, or has another version of it, is named in one sentence."""

import shutil
import subprocess
import sys
import venv
from collections.abc import Iterator
from pathlib import Path

import pytest
import ray

from tests.ray_nodes import REPOSITORY, Cluster, without_ray

JOIN = """
from tactile_core import cluster, errors, nodes
nodes.LOOK_SECONDS = 300  # a busy machine takes its time to start a process
try:
    with cluster.joined():
        print("SAID joined")
except errors.TactileError as error:
    print("SAID", error)
"""


@pytest.fixture(scope="module")
def cluster() -> Iterator[Cluster]:
    """A head that does no work."""
    running = Cluster()
    try:
        running.start(cpus=0)
        yield running
    finally:
        running.shut_down()


def python_without_package(folder: Path) -> Path:
    """A Python that has everything that this one has but for this package."""
    venv.create(folder, symlinks=True)
    [packages] = folder.glob("lib/python3*/site-packages")
    for place in Path(ray.__file__).parents[1].iterdir():
        if "tactile" not in place.name and place.suffix != ".pth":
            (packages / place.name).symlink_to(place)
    return packages


def join(cluster: Cluster, folder: Path) -> str:
    """What another process says that joins the cluster, from a folder where nothing is.

    Ray may say before that it misses a node that was killed.
    """
    variables = {**cluster.variables, "RAY_ADDRESS": cluster.address}
    done = subprocess.run(
        [sys.executable, "-c", JOIN], cwd=folder, capture_output=True, text=True, timeout=600,
        env={**without_ray(), **variables, "PYTHONPATH": str(REPOSITORY)}, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout.partition("SAID ")[2]


@pytest.mark.timeout(1800)
def test_a_node_that_does_not_fit_is_named_with_what_it_lacks(cluster, tmp_path):
    assert join(cluster, tmp_path).startswith("no node of the Ray cluster has processors")

    packages = python_without_package(tmp_path / "other")
    python = str(tmp_path / "other" / "bin" / "python")
    node = cluster.start(python=python)
    said = join(cluster, tmp_path)
    assert said.startswith(f"node {node} of the Ray cluster lacks this package"), said
    assert said.count("\n") == 1
    cluster.kill(node)

    shutil.copytree(REPOSITORY / "tactile_core", packages / "tactile_core")
    with (packages / "tactile_core" / "errors.py").open("a") as file:
        file.write("CHANGED = True\n")
    [information] = Path(ray.__file__).parents[1].glob("tactile_exploration-*.dist-info")
    (packages / information.name).symlink_to(information)
    node = cluster.start(python=python)
    said = join(cluster, tmp_path)
    assert said.startswith(f"node {node} of the Ray cluster has tactile-exploration "), said
    assert said.count("\n") == 1
