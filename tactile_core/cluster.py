"""Ray: a cluster that is there already, or one of this machine's own for as long as it is needed.

Ray (2.60) listens on every interface and cannot be told otherwise: whoever reaches it without being
asked for a token can run code in it. So a local Ray asks, and its secret lies in the home.
"""

import contextlib
import logging
import os
import secrets
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import grpc
import psutil
import ray
from ray.exceptions import RayError

from tactile_core import ray_folders
from tactile_core.errors import TactileError
from tactile_core.machine import processors
from tactile_core.nodes import check_nodes

# Without these Ray's own loggers write files where it runs.
QUIET_RAY = {
    "TUNE_DISABLE_AUTO_CALLBACK_LOGGERS": "1",
    "RAY_AIR_NEW_OUTPUT": "0",  # the old output heeds verbose=0, the new one prints a banner
    "RAY_USAGE_STATS_ENABLED": "0",
}
CONNECT_SECONDS, ANSWER_SECONDS = 5, 10


@contextmanager
def running_ray(concurrent: int, token: Path) -> Iterator[None]:
    """A connection to the cluster at `RAY_ADDRESS`, or a local Ray for the block's duration.

    concurrent : tasks that a local Ray runs at a time, at least one for each processor
    token : file of the local Ray's secret, made where it is not there
    """
    with joined() if os.environ.get("RAY_ADDRESS") else local_ray(concurrent, token):
        yield


@contextmanager
def joined() -> Iterator[None]:
    """A connection to the cluster at `RAY_ADDRESS` for the block's duration.

    Raises `TactileError` within half a minute where nothing answers there, or where a node has not
    the same package as this process.
    """
    quiet()
    address = os.environ["RAY_ADDRESS"]
    check_answers(address)
    try:
        ray.init(address, log_to_driver=False, logging_level=logging.ERROR)
    except ConnectionError as error:
        raise nobody_there(address, f"{first_line(error)}; is its token another?") from error
    except (RayError, RuntimeError, ValueError) as error:
        raise nobody_there(address, first_line(error)) from error
    try:
        check_nodes()
        yield
    finally:
        ray.shutdown()


@contextmanager
def local_ray(concurrent: int, token: Path) -> Iterator[None]:
    """A Ray of this machine alone for the block's duration."""
    quiet()
    # Where no mode is set Ray asks for a token. What it remembers may be another home's.
    os.environ["RAY_AUTH_TOKEN_PATH"] = str(ready_token(token))
    for name in ("RAY_AUTH_MODE", "RAY_AUTH_TOKEN"):
        os.environ.pop(name, None)
    forget_token()
    os.environ[ray_folders.VARIABLE] = str(ray_folders.own_folder())
    try:
        ray.init(
            "local",
            num_cpus=max(concurrent, processors()),
            include_dashboard=False,
            log_to_driver=False,
            logging_level=logging.ERROR,
            _temp_dir=str(ray_folders.own_folder()),
        )
    finally:
        del os.environ[ray_folders.VARIABLE]  # what else this process starts is not that Ray's
    try:
        yield
    finally:
        ray.shutdown()
        ray_folders.remove_ray(ray_folders.own_folder())


def quiet() -> None:
    for name, value in QUIET_RAY.items():
        os.environ.setdefault(name, value)


def forget_token() -> None:
    """Have Ray read its token anew: it remembers the first, and has no public way to forget it."""
    from ray._raylet import AuthenticationTokenLoader  # type: ignore[attr-defined]

    AuthenticationTokenLoader.instance().reset_cache()


def ready_token(path: Path) -> Path:
    """The file of a secret that only this user can read; made at random where there is none."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        aside = path.with_name(f".{path.name}.{os.getpid()}.part")
        with os.fdopen(os.open(aside, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "w") as file:
            file.write(secrets.token_hex(32))
        aside.replace(path)
    return path


def check_answers(address: str) -> None:
    """Raises `TactileError` where no Ray cluster answers at `address`, or this machine cannot join.

    Ray itself would wait for a quarter of an hour. "auto" it looks up on this machine, quickly.
    """
    if address in ("auto", "local"):
        return
    host, _, port = address.removeprefix("ray://").rpartition(":")
    try:
        socket.create_connection((host, int(port)), timeout=CONNECT_SECONDS).close()
    except (OSError, ValueError) as error:
        raise nobody_there(address, str(error)) from error
    if address.startswith("ray://"):
        return
    with grpc.insecure_channel(address) as channel:
        try:
            grpc.channel_ready_future(channel).result(ANSWER_SECONDS)
        except grpc.FutureTimeoutError as error:
            raise nobody_there(address, f"no answer in {ANSWER_SECONDS} seconds") from error
    if not has_node():
        raise TactileError(
            f"RAY_ADDRESS={address} names a Ray cluster that this machine is no node of: run "
            f"`ray start --address={address} --num-cpus=0` here first"
        )


def has_node() -> bool:
    """Whether a node of a Ray cluster runs on this machine."""
    for process in psutil.process_iter():
        with contextlib.suppress(psutil.Error):  # it may be gone by now
            if process.name() == "raylet":
                return True
    return False


def first_line(error: Exception) -> str:
    return next(
        (line.strip()[:200] for line in str(error).splitlines() if line.strip()), repr(error)
    )


def nobody_there(address: str, reason: str) -> TactileError:
    return TactileError(
        f"RAY_ADDRESS={address} names a Ray cluster that cannot be used ({reason}): correct or "
        "start it, or unset RAY_ADDRESS to work on this machine alone"
    )
