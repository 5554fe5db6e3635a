"""The whole chain on a Ray cluster of two nodes, one of which dies, and nodes that do not fit."""

import json
from collections.abc import Iterator

import dagster as dg
import pytest

from tests.assets.running import ALL, Platform, begin, run_config, until
from tests.ray_nodes import Cluster


@pytest.fixture
def cluster() -> Iterator[Cluster]:
    """Two nodes of one processor each."""
    running = Cluster()
    try:
        running.start()
        running.start()
        yield running
    finally:
        running.shut_down()


@pytest.mark.timeout(1800)
def test_a_node_that_dies_in_the_middle_changes_nothing(chain, cluster, tmp_path):
    """No disk is shared but the store: checkpoints lie there, too."""
    first, second = cluster.nodes
    config = tmp_path / "tiny.yaml"
    config.write_text(json.dumps(run_config()))
    home = tmp_path / "home"
    home.mkdir()
    with begin(
        f"dagster job execute --job whole_chain -c {config}", home,
        TACTILE_STORE=str(tmp_path / "store"), RAY_ADDRESS=cluster.address, **cluster.variables,
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
    assert not list((home / "cache").iterdir())
    with dg.DagsterInstance.from_config(str(home / "dagster")) as instance:
        assert Platform(home, instance).data_versions(ALL) == chain.data_versions(ALL)
