"""The whole chain with `TACTILE_STORE` in S3: nothing but caches and checkpoints on a disk."""

import json
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass

import dagster as dg
import pytest

from tactile_assets.resources import Store
from tests.assets.running import ALL, Platform, begin, run_config
from tests.object_store import BUCKET, ObjectStore, object_store

STORE = f"s3://{BUCKET}/store"
KILLED_AT = "policies[gain_0]"


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
    config = tmp_path / "tiny.yaml"
    config.write_text(json.dumps(run_config()))
    command = f"dagster asset materialize --select '*' -c {config}"
    kill_at_line(KILLED_AT, begin(command, tmp_path, TACTILE_STORE=STORE, **s3.variables))
    keys = s3.names()
    assert "store/run.lock" in keys  # as the run claimed the store and was killed
    assert "store/unet/settings.json" in keys and "store/policies/index.json" not in keys
    with dg.DagsterInstance.from_config(str(tmp_path / "dagster")) as instance:
        platform = PlatformInS3(tmp_path, instance)
        left = [asset for asset in ALL if f"store/{asset}.parquet" not in s3.names()]
        left.remove("unet")  # its files lie in a folder, and were there
        platform.materialise(*left)
        assert platform.data_versions(ALL) == chain.data_versions(ALL)
    assert not [name for name in s3.names() if ".part" in name]
    assert not (tmp_path / "artifacts").exists()


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
