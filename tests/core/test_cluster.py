"""Ray asks strangers for a token, and a cluster that is not there is told in a sentence."""

import shutil
import socket
import stat
import subprocess
import sys
import threading
from pathlib import Path

import psutil
import pytest
import ray

from tactile_core import cluster
from tactile_core.cluster import check_answers, ready_token, running_ray
from tactile_core.errors import TactileError
from tactile_core.ray_folders import remove_dead_rays, short_folder
from tests.ray_nodes import without_ray

JOIN = """
import ray, sys
ray.init(sys.argv[1], log_to_driver=False)
print(ray.get(ray.remote(lambda: "ran code")._remote()))
"""
TWO_HOMES = """
import ray, sys
from pathlib import Path
from tactile_core.cluster import running_ray
for home in (1, 2):
    with running_ray(1, Path(sys.argv[1], str(home), "ray-token")):
        print(ray.get(ray.remote(lambda: home)._remote()))
"""


@pytest.fixture(scope="module")
def address(ray_token):
    """The address of a local Ray that runs."""
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("RAY_ADDRESS", raising=False)
        with running_ray(1, ray_token):
            yield ray.get_runtime_context().gcs_address


def running(script: str, argument: str) -> subprocess.CompletedProcess:
    """A script that another process has run."""
    return subprocess.run(
        [sys.executable, "-c", script, argument],
        env=without_ray(), capture_output=True, text=True, timeout=200, check=False,
    )  # fmt: skip


def joining(address: str, home, **variables: str) -> subprocess.Popen:
    """Another process that tries to have code run there."""
    return subprocess.Popen(
        [sys.executable, "-c", JOIN, address],
        env={**without_ray(), "HOME": str(home), **variables},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def test_the_token_is_a_secret_of_this_user_and_stays_the_same(tmp_path):
    token = ready_token(tmp_path / "new" / "ray-token")
    assert stat.S_IMODE(token.stat().st_mode) == 0o600
    secret = token.read_text()
    assert len(secret) == 64
    assert ready_token(token).read_text() == secret
    assert ready_token(tmp_path / "other").read_text() != secret
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["new", "other", "ray-token"]


def test_who_has_no_token_cannot_join_a_local_ray(address, tmp_path):
    strangers = [joining(address, tmp_path)]  # at once: Ray lets each wait long for its answer
    strangers += [joining(address, tmp_path, RAY_AUTH_MODE=mode) for mode in ("disabled", "token")]
    for stranger in strangers:
        said, _ = stranger.communicate(timeout=120)
        assert stranger.returncode != 0
        assert "ran code" not in said


def test_who_has_the_token_can(address, ray_token, tmp_path):
    token = str(ray_token)
    friend = joining(address, tmp_path, RAY_AUTH_MODE="token", RAY_AUTH_TOKEN_PATH=token)
    said, errors = friend.communicate(timeout=120)
    assert said.endswith("ran code\n"), errors
    assert not (tmp_path / ".ray").exists()


def test_one_process_may_use_the_rays_of_two_homes(tmp_path):
    done = running(TWO_HOMES, str(tmp_path))
    assert done.stdout == "1\n2\n", done.stderr


@pytest.fixture
def silent():
    """The address of something that takes connections and never says a word."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        taken = []

        def take():
            while True:
                try:
                    taken.append(server.accept())
                except OSError:
                    return

        threading.Thread(target=take, daemon=True).start()
        yield f"127.0.0.1:{server.getsockname()[1]}"
        server.shutdown(socket.SHUT_RDWR)


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return server.getsockname()[1]


def test_a_cluster_that_is_not_there_is_told_in_one_sentence(monkeypatch, tmp_path):
    for address in (
        f"127.0.0.1:{free_port()}", f"ray://127.0.0.1:{free_port()}", "no.such.host.invalid:6379",
        "127.0.0.1", "host:port",
    ):  # fmt: skip
        monkeypatch.setenv("RAY_ADDRESS", address)
        with (
            pytest.raises(TactileError, match=f"RAY_ADDRESS={address} names") as refused,
            running_ray(1, tmp_path / "token"),
        ):
            pass
        assert "\n" not in str(refused.value)


def test_something_else_at_the_address_is_told_too(silent, monkeypatch):
    monkeypatch.setattr(cluster, "ANSWER_SECONDS", 3)
    with pytest.raises(TactileError, match="cannot be used"):
        check_answers(silent)


def test_a_cluster_that_answers_is_taken(address):
    check_answers(address)


def test_sockets_lie_where_their_paths_are_short_enough(monkeypatch, tmp_path):
    long = tmp_path / ("slurm-" + "x" * 90)
    long.mkdir()
    monkeypatch.setenv("RAY_TMPDIR", str(long))
    assert str(short_folder()) == "/tmp"
    monkeypatch.setenv("RAY_TMPDIR", "/var/tmp")
    assert str(short_folder()) == "/var/tmp"


WORKS = """
import ray, sys, time
from pathlib import Path
from tactile_core.cluster import running_ray
with running_ray(1, Path(sys.argv[1])):
    worker = ray.remote(lambda: __import__("os").getpid())
    print(ray.get(worker._remote()), flush=True)
    ray.get(ray.remote(lambda: time.sleep(600))._remote())
"""


def test_a_killed_driver_leaves_no_folder_and_no_process(tmp_path):
    with subprocess.Popen(
        [sys.executable, "-c", WORKS, str(tmp_path / "token")],
        env=without_ray(), stdout=subprocess.PIPE, text=True,
    ) as driver:  # fmt: skip
        worker = int(driver.stdout.readline())
        folder = short_folder() / f"ray-{driver.pid}"
        assert folder.is_dir() and psutil.pid_exists(worker)
        driver.kill()
    assert remove_dead_rays() >= 1
    assert not folder.exists()
    psutil.wait_procs([psutil.Process(worker)] if psutil.pid_exists(worker) else [], timeout=60)
    assert not psutil.pid_exists(worker)


def test_a_folder_that_is_only_called_as_a_ray_s_stays(tmp_path, monkeypatch):
    monkeypatch.setenv("RAY_TMPDIR", "/tmp")
    with subprocess.Popen(["true"]) as gone:
        pass
    folder = Path("/tmp", f"ray-{gone.pid}")
    folder.mkdir()
    (folder / "thesis.tex").write_text("")
    try:
        remove_dead_rays()
        assert (folder / "thesis.tex").exists()
    finally:
        shutil.rmtree(folder)


# Ray ends its workers and their children, but not the children's own.
LEAVES = """
import ray, subprocess, sys
from pathlib import Path
from tactile_core.cluster import running_ray
from tactile_core.processes import works
begin = ["bash", "-c", "setsid sleep 600 > /dev/null & echo $!"]
with running_ray(1, Path(sys.argv[1])):
    said = ray.get(ray.remote(lambda: subprocess.check_output(begin, text=True))._remote())
    print(works(int(said)))
print(works(int(said)))
"""


def test_nothing_that_runs_for_a_local_ray_outlives_it(tmp_path):
    done = running(LEAVES, str(tmp_path / "token"))
    assert done.stdout == "True\nFalse\n", done.stderr
