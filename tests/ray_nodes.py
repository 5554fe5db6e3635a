"""Ray clusters with a token: nodes on this machine, as several machines would be, or one alone."""

import contextlib
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest
from ray import cluster_utils

from tactile_core.cluster import QUIET_RAY, ready_token, running_ray

REPOSITORY = Path(__file__).resolve().parents[1]


class Cluster:
    """Its nodes by their addresses, which are all of this machine: 127.0.0.2, 127.0.0.3 and on.

    Ray listens on every interface, whatever the address of a node; hence the token.
    """

    def __init__(self) -> None:
        # Short, for the paths of Ray's sockets.
        self.folder = Path(tempfile.mkdtemp(prefix="ray", dir="/tmp"))
        self.variables = {
            "RAY_AUTH_MODE": "token",
            "RAY_AUTH_TOKEN_PATH": str(ready_token(self.folder / "token")),
            "RAY_USAGE_STATS_ENABLED": "0",
        }
        self.nodes: dict[str, subprocess.Popen] = {}
        self.address = ""

    def start(self, cpus: int = 1, python: str = sys.executable) -> str:
        """Start a node, the first as head; its address."""
        host = f"127.0.0.{len(self.nodes) + 2}"
        if self.address:
            place = ["--address", self.address]
        else:
            port = free_port(host)
            self.address = f"{host}:{port}"
            place = ["--head", "--port", str(port), "--temp-dir", str(self.folder)]
            place += ["--include-dashboard", "false"]
        log = self.folder / f"{host}.log"
        with log.open("wb") as said:
            self.nodes[host] = subprocess.Popen(
                [
                    python, "-m", "ray.scripts.scripts", "start", "--block", *place,
                    "--node-ip-address", host, "--num-cpus", str(cpus), "--num-gpus", "0",
                    "--object-store-memory", str(100 * 2**20),
                ],
                env={**without_ray(), **self.variables}, cwd=self.folder,
                stdout=said, stderr=subprocess.STDOUT,
            )  # fmt: skip
        while "Ray runtime started" not in log.read_text() and self.nodes[host].poll() is None:
            time.sleep(0.1)
        assert self.nodes[host].poll() is None, log.read_text()
        return host

    def works(self, host: str, name: str) -> bool:
        """Whether a task of this name is under way on a node."""
        for process in self.children(host):
            with contextlib.suppress(psutil.Error):  # it may be gone by now
                if f"ray::{name}" in " ".join(process.cmdline()):
                    return True
        return False

    def kill(self, host: str) -> None:
        """What a node whose power is cut leaves: nothing."""
        children = self.children(host)
        self.nodes[host].kill()
        for child in children:
            child.kill()
        psutil.wait_procs(children)
        self.nodes[host].wait()

    def children(self, host: str) -> list[psutil.Process]:
        return psutil.Process(self.nodes[host].pid).children(recursive=True)

    def shut_down(self) -> None:
        for host, node in self.nodes.items():
            if node.poll() is None:
                self.kill(host)
        shutil.rmtree(self.folder, ignore_errors=True)


def without_ray() -> dict[str, str]:
    """This environment but for what is said to Ray in it."""
    return {name: value for name, value in os.environ.items() if not name.startswith("RAY_")}


def free_port(host: str) -> int:
    with socket.create_server((host, 0)) as server:
        return server.getsockname()[1]


@contextlib.contextmanager
def one_node(processors: int, token: Path) -> Iterator[None]:
    """A node of so many processors, named by RAY_ADDRESS, that asks for the secret in `token`."""
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("RAY_ADDRESS", raising=False)
        with running_ray(1, token):  # the first in this process: from here on there are tokens
            pass
        for name, value in QUIET_RAY.items():
            patch.setenv(name, value)
        running = cluster_utils.Cluster(
            initialize_head=True,
            head_node_args={"num_cpus": processors, "include_dashboard": False},
        )
        patch.setenv("RAY_ADDRESS", running.address)
        yield
        running.shutdown()
