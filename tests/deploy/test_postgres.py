"""deploy/dagster.yaml against a real PostgreSQL: runs are recorded there, and found dead there."""

import os
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import dagster as dg
import pytest
import yaml

from tactile_assets.paths import REPOSITORY
from tests.assets.running import shell

pytest.importorskip("dagster_postgres")
DEPLOY = REPOSITORY / "deploy"
BINARIES = sorted(Path("/usr/lib/postgresql").glob("*/bin")) or [Path("/usr/local/bin")]


def postgres(program: str, *arguments: str) -> None:
    """Run a program of PostgreSQL's, which refuses to work for root."""
    command = [str(BINARIES[-1] / program), *arguments]
    if os.getuid() == 0:
        command = ["runuser", "-u", "postgres", "--", *command]
    subprocess.run(command, check=True, capture_output=True, text=True, timeout=120)


@pytest.fixture
def url(tmp_path_factory) -> Iterator[str]:
    """The URL of a PostgreSQL of its own, reached by a socket alone."""
    if not (BINARIES[-1] / "initdb").exists():
        pytest.skip("PostgreSQL is not installed (Debian: apt install postgresql)")
    place = Path("/tmp", f"pg-{os.getpid()}")  # a socket's path is short
    place.mkdir()
    if os.getuid() == 0:
        shutil.chown(place, "postgres")
    data = str(place / "data")
    options = f"-c listen_addresses='' -c unix_socket_directories={place} -c fsync=off"
    try:
        postgres("initdb", "--pgdata", data, "--auth", "trust", "--username", "tactile")
        postgres("pg_ctl", "start", "--pgdata", data, "--wait", "-l", f"{place}/log", "-o", options)
        try:
            yield f"postgresql+psycopg2://tactile@/postgres?host={place}"
        finally:
            postgres("pg_ctl", "stop", "--pgdata", data, "--mode", "immediate")
    finally:
        shutil.rmtree(place)


def test_it_says_what_the_other_says_and_where_the_records_lie():
    ours, plain = (
        yaml.safe_load(file.read_text())
        for file in (DEPLOY / "dagster.yaml", REPOSITORY / "dagster.yaml")
    )
    assert ours == {**plain, "storage": {"postgres": {"postgres_url": {"env": "TACTILE_POSTGRES"}}}}


def test_runs_are_recorded_in_postgresql_alone(url, tmp_path, monkeypatch):
    (tmp_path / "dagster").mkdir()
    shutil.copy(DEPLOY / "dagster.yaml", tmp_path / "dagster")
    done = shell(
        "dagster asset materialize --select shapenet_meshes", tmp_path, TACTILE_POSTGRES=url
    )
    assert done.returncode == 0, done.stderr
    assert not list(tmp_path.rglob("*.db"))
    monkeypatch.setenv("TACTILE_POSTGRES", url)
    with dg.DagsterInstance.from_config(str(tmp_path / "dagster")) as instance:
        [run] = instance.get_runs()
        assert run.is_success
        event = instance.get_latest_materialization_event(dg.AssetKey("shapenet_meshes"))
        assert event.run_id == run.run_id
