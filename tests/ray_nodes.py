"""Nodes of a Ray cluster on this machine, with a token, as several machines would be."""

import contextlib
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import psutil

from tactile_core.cluster import ready_token

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
