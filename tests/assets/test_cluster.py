"""The whole chain on a Ray cluster of two nodes, one of which dies; they share a store in S3."""

import json
from collections.abc import Iterator

import dagster as dg
import pytest

from tests.assets.running import ALL, Platform, begin, run_config, until
from tests.object_store import BUCKET, ObjectStore, object_store
from tests.ray_nodes import Cluster


@pytest.fixture
def s3(monkeypatch) -> Iterator[ObjectStore]:
    with object_store(monkeypatch) as store:
        yield store


@pytest.fixture
def cluster(s3) -> Iterator[Cluster]:
    """Two nodes of one processor each, which find the store."""
    running = Cluster()
    try:
        running.start()
        running.start()
        yield running
    finally:
        running.shut_down()


@pytest.mark.timeout(1800)
def test_a_node_that_dies_in_the_middle_changes_nothing(chain, s3, cluster, tmp_path):
    """No disk is shared: checkpoints lie in the store, too."""
    first, second = cluster.nodes
    config = tmp_path / "tiny.yaml"
    config.write_text(json.dumps(run_config()))
    home = tmp_path / "home"
    home.mkdir()
    with begin(
        f"dagster job execute --job whole_chain -c {config}", home,
        TACTILE_STORE=f"s3://{BUCKET}/store", RAY_ADDRESS=cluster.address,
        **s3.variables, **cluster.variables,
    ) as run:  # fmt: skip
        until(lambda: cluster.works(second, "train_policy") or run.poll() is not None, seconds=1500)
        cluster.kill(second)
        said = "".join(run.communicate())
    assert run.returncode == 0, said
    done = [line for line in said.splitlines() if "done by the Ray cluster" in line]
    for work in ("render_there", "train_unet", "train_policy", "cast_samples"):
        assert any(work in line for line in done), said
    assert any(first in line for line in done) and any(second in line for line in done), said
    assert not any(second in line for line in done if "cast_samples" in line), said
    kept = [place.name for place in (home / "cache").iterdir()]
    assert kept == ["rollouts"]  # until they are seen to be stored
    assert not (home / "artifacts").exists()
    assert not [name for name in s3.names() if ".part" in name or name.endswith("run.lock")]
    with dg.DagsterInstance.from_config(str(home / "dagster")) as instance:
        assert Platform(home, instance).data_versions(ALL) == chain.data_versions(ALL)
