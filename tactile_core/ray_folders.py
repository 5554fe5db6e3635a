"""The folder of a local Ray, by the number of its driver: what a killed one leaves can be found."""

import os
import re
import shutil
import tempfile
from pathlib import Path

import psutil

from tactile_core.errors import TactileError
from tactile_core.processes import end_those_with

VARIABLE = "TACTILE_RAY_FOLDER"  # tells which Ray a process belongs to
NAME = re.compile(r"ray-(\d+)")
# A socket's path has 107 bytes at most, and Ray puts some 80 of its own below this folder.
LONGEST_FOLDER = 24


def own_folder() -> Path:
    """Where a local Ray of this process keeps its files."""
    return short_folder() / f"ray-{os.getpid()}"


def short_folder() -> Path:
    """A folder for temporary files whose path leaves room for the names of Ray's sockets."""
    wanted = os.environ.get("RAY_TMPDIR") or tempfile.gettempdir()
    for folder in (wanted, "/tmp", "/var/tmp", "/dev/shm"):
        if len(folder.encode()) <= LONGEST_FOLDER and os.access(folder, os.W_OK | os.X_OK):
            return Path(folder)
    raise TactileError(
        f"{wanted} is too long a path for Ray's sockets: set RAY_TMPDIR to a folder of at most "
        f"{LONGEST_FOLDER} letters"
    )


def remove_dead_rays() -> int:
    """Remove the folders of local Rays whose drivers are gone, with the processes that outlived
    them; how many they were. What is only called so, and holds no session of Ray's, stays."""
    dead = []
    for folder in short_folder().glob("ray-*"):
        driver = NAME.fullmatch(folder.name)
        gone = driver and not psutil.pid_exists(int(driver[1]))
        if gone and os.access(folder, os.W_OK) and any(folder.glob("session_*")):
            dead.append(folder)
    for folder in dead:
        remove_ray(folder)
    return len(dead)


def remove_ray(folder: Path) -> None:
    """Remove the folder of a local Ray that has ended, with the processes that outlived it.

    Ray ends its workers and what they started, but not what those started in turn; and a raylet
    that takes longer than a second it kills, and its workers have to notice.
    """
    end_those_with(VARIABLE, str(folder))
    shutil.rmtree(folder, ignore_errors=True)
