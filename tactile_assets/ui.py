"""Dagster's web interface and its daemon, as `make ui` starts them: `python -m tactile_assets.ui`.

`dagster dev` would do, but for the figures that our webserver has beside Dagster's pages.
"""

import os
import signal
import socket
import subprocess
import sys
import time
import webbrowser
from collections.abc import Sequence
from urllib.error import URLError
from urllib.request import urlopen

from tactile_assets.config import PROFILE, which_profile
from tactile_assets.paths import REPOSITORY
from tactile_assets.resources import Store
from tactile_core.errors import TactileError

HOST, PORT = "127.0.0.1", 3000
PATIENCE = 5.0  # seconds that both have to end by themselves: pages that stay open hold them
GROUPS = ("dataset", "reconstruction", "exploration", "evaluation")
GRAPH = "/asset-groups?expanded=" + ",".join(f"global@global:{group}" for group in GROUPS)
RESULTS = "/assets/per_step_evaluation"
WEBSERVER = ("tactile_assets.webserver", "--dagster-log-level", "warning",
             "--code-server-log-level", "warning")  # fmt: skip
DAEMON = ("dagster._daemon", "run", "--log-level", "warning")


def main() -> None:
    """Start both, say where to look once the pages answer, and end with an interrupt."""
    home = Store.from_environment().home
    port = free_port()
    which = which_profile()
    # Runs that are started here have this profile, whatever runs in this home meanwhile.
    os.environ["TACTILE_PROFILE"] = PROFILE.name
    for ending in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(ending, lambda *_: sys.exit(0))
    print(f"Starting: {which}, home {home}", flush=True)
    services = [
        start(*WEBSERVER, "--host", HOST, "--port", str(port)),
        start(*DAEMON),
    ]
    try:
        wait_until_it_answers(f"http://{HOST}:{port}/server_info", services)
        say_where_to_look(f"http://localhost:{port}")
        while all_run(services):
            time.sleep(0.5)
    finally:
        end(services)


def free_port() -> int:
    """3000, or where that is taken any other."""
    for port in (PORT, 0):
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind((HOST, port))
            except OSError:
                continue
            return int(probe.getsockname()[1])
    raise TactileError(f"no port of {HOST} is free")


def start(module: str, *options: str) -> subprocess.Popen:
    """Start a module of Dagster's that serves our assets."""
    workspace = ("--workspace", str(REPOSITORY / "workspace.yaml"))
    return subprocess.Popen([sys.executable, "-m", module, *options, *workspace])


def end(services: Sequence[subprocess.Popen]) -> None:
    """Ask all of them to end, and end those that do not; runs are processes of their own."""
    for process in services:
        process.terminate()
    last = time.monotonic() + PATIENCE
    for process in services:
        try:
            process.wait(max(0, last - time.monotonic()))
        except subprocess.TimeoutExpired:
            process.kill()


def all_run(services: Sequence[subprocess.Popen]) -> bool:
    """True; raises `TactileError` where one of them has ended."""
    for process in services:
        if process.poll() is not None:
            raise TactileError("the web interface or its daemon has ended: lines above say why")
    return True


def wait_until_it_answers(address: str, services: Sequence[subprocess.Popen]) -> None:
    while all_run(services):
        try:
            with urlopen(address, timeout=5):
                return
        except (URLError, OSError):
            time.sleep(0.2)


def say_where_to_look(address: str) -> None:
    """Print the pages to begin with, and open the first one where there is a desktop."""
    print(f"The graph:    {address}{GRAPH}")
    print(f"The results:  {address}{RESULTS}")
    print("Ctrl-C ends it.", flush=True)
    if os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY") or sys.platform == "darwin":
        webbrowser.open(address + GRAPH)


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        pass
    except TactileError as error:
        sys.exit(str(error))
