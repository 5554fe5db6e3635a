"""What learns, with `TACTILE_STORE` in S3: nothing but caches and checkpoints on a disk.

The whole chain with such a store is in test_cluster.py.
"""

import json
import shlex
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import dagster as dg
import pytest

from tactile_assets.resources import Store
from tests.assets.running import ALL, Platform, begin, run_for, shell
from tests.object_store import BUCKET, ObjectStore, object_store

STORE = f"s3://{BUCKET}/store"
KILLED_AT = "policies[gain_0]"
MADE = ALL[ALL.index("unet_search") + 1 :]


@dataclass(frozen=True)
class PlatformInS3(Platform):
    @property
    def store(self) -> Store:
        return Store(home=str(self.home), artifacts=STORE)


@pytest.fixture
def s3(monkeypatch) -> Iterator[ObjectStore]:
    with object_store(monkeypatch) as store:
        yield store


def test_a_killed_run_ends_in_the_data_versions_of_one_on_a_disk(chain, s3, tmp_path):
    for asset in set(ALL) - set(MADE):
        s3.put(f"store/{asset}.parquet", Path(chain.store.path(f"{asset}.parquet")).read_bytes())
    config = tmp_path / "tiny.yaml"
    config.write_text(json.dumps(run_for(tuple(MADE))))
    command = f"dagster asset materialize --select {','.join(MADE)} -c {config}"
    kill_at_line(KILLED_AT, begin(command, tmp_path, TACTILE_STORE=STORE, **s3.variables))
    keys = s3.names()
    assert "store/run.lock" in keys  # as the run claimed the store and was killed
    assert "store/unet/settings.json" in keys and "store/policies/index.json" not in keys
    with dg.DagsterInstance.from_config(str(tmp_path / "dagster")) as instance:
        platform = PlatformInS3(tmp_path, instance)
        left = [asset for asset in MADE if f"store/{asset}.parquet" not in s3.names()]
        left.remove("unet")  # its files lie in a folder, and were there
        platform.materialise(*left)
        assert platform.data_versions(MADE) == chain.data_versions(MADE)
    assert not [name for name in s3.names() if ".part" in name]
    assert not (tmp_path / "artifacts").exists()


def test_a_store_without_a_key_is_told_in_one_line(tmp_path):
    done = shell(
        "python -m tactile_core results", tmp_path,
        TACTILE_STORE=STORE, AWS_EC2_METADATA_DISABLED="true",
    )  # fmt: skip
    assert done.returncode == 1
    [line] = done.stderr.splitlines()
    assert line.startswith(f"Error: {STORE}/reconstruction_evaluation.parquet cannot be read (")
    assert "credentials" in line and line.endswith("): mend that")


def test_what_is_out_of_reach_is_not_taken_for_missing(tmp_path):
    """Else `make run` would begin to make it all anew."""
    code = """
from tactile_assets.fresh import Store, stored_version
from tactile_core.errors import OutOfReachError
for asset in ("masks", "unet", "policies"):
    try:
        stored_version(Store.from_environment(), asset)
    except OutOfReachError as error:
        print(error)
"""
    lines = said_without_a_key(code, tmp_path)
    for line, name in zip(lines, ("masks", "unet", "unet"), strict=True):
        assert line.startswith(f"{STORE}/{name}") and line.endswith("): mend that")
        assert "credentials" in line


def test_a_store_without_a_key_sets_no_mesh_aside_trains_nothing_anew_and_damages_no_step(tmp_path):
    code = f"""
import dagster as dg
from upath import UPath
from tactile_assets.io_managers import Steps
from tactile_core.exploration.learning.train import finished
from tactile_core.dataset.rendering.silhouettes import Job, render
from tactile_core.errors import OutOfReachError
from tactile_core.reconstruction.trained import unet_at
root = UPath("{STORE}")
with dg.build_input_context() as context:
    for read in (
        lambda: render(Job("a.obj", "0", ()), root, 64, None),
        lambda: unet_at(root / "unet"),
        lambda: finished(root / "policies", "of some key"),
        lambda: Steps(base_path=root).load_from_path(context, root / "planned.json"),
    ):
        try:
            print(read())
        except OutOfReachError as error:
            print(error)
"""
    lines = said_without_a_key(code, tmp_path)
    names = ("a.obj", "unet/settings.json", "policies/settings.json", "planned.json")
    for line, name in zip(lines, names, strict=True):
        assert line.startswith(f"{STORE}/{name} cannot be read (") and line.endswith("): mend that")


def test_a_store_that_takes_nothing_is_told_in_a_sentence(tmp_path):
    code = f"""
import dagster as dg
from upath import UPath
from tactile_assets.prune import prune
from tactile_assets.resources import Store
from tactile_core.errors import OutOfReachError
from tactile_core.files import written_whole
from tactile_core.settings import PruneSettings
def write():
    with written_whole(UPath("{STORE}/masks.parquet")) as file:
        file.write(b"a table")
def prune_it():
    with dg.DagsterInstance.ephemeral() as instance:
        prune(instance, Store.from_environment(), PruneSettings(), print)
for attempt in (write, prune_it):
    try:
        print(attempt())
    except OutOfReachError as error:
        print(error)
"""
    lines = said_without_a_key(code, tmp_path)
    for line, what in zip(
        lines, ("/masks.parquet cannot be written (", " cannot be listed ("), strict=True
    ):
        assert line.startswith(f"{STORE}{what}") and line.endswith("): mend that")


def test_a_figure_in_a_store_without_a_key_is_told_in_the_browser_in_a_sentence(tmp_path):
    code = """
from starlette.applications import Starlette
from starlette.routing import Route
from starlette.testclient import TestClient
from tactile_assets.webserver import figure
answer = TestClient(Starlette(routes=[Route("/{name}", figure)])).get("/masks.png")
print(answer.status_code, answer.text)
"""
    [line] = said_without_a_key(code, tmp_path)
    assert line.startswith(f"503 {STORE}/figures/masks.png cannot be read (")


def said_without_a_key(code: str, home: Path) -> list[str]:
    """The lines that a program prints whose store is in S3, without a key to it."""
    done = shell(
        f"python -c {shlex.quote(code)}", home,
        TACTILE_STORE=STORE, AWS_EC2_METADATA_DISABLED="true",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def kill_at_line(text: str, process: subprocess.Popen) -> None:
    """Kill a process once it says a line with `text`."""
    assert process.stderr is not None
    try:
        lines = []
        for line in process.stderr:
            lines.append(line)
            if text in line:
                return
        raise AssertionError("".join(lines))
    finally:
        process.kill()
        process.communicate()
