"""Processes: which one works, whether it still does, and that its helpers end with it."""

import contextlib
import ctypes
import os
import signal
import socket
import sys
import time
from typing import NamedTuple

import psutil

SET_PARENT_DEATH_SIGNAL = 1  # Linux: prctl's PR_SET_PDEATHSIG
KILLED_SECONDS = 10  # one that was killed lets go of its memory first, on a busy machine slowly
CLOCK_STEP = 2.0  # seconds: a clock that is set moves the start of every process


class Worker(NamedTuple):
    """A process: the machine's name, its number there, and when it started (Unix time)."""

    host: str
    pid: int
    started: float

    @classmethod
    def here(cls) -> "Worker":
        """This process."""
        return cls.of(os.getpid())

    @classmethod
    def of(cls, pid: int) -> "Worker":
        """The process of this number on this machine."""
        return cls(socket.gethostname(), pid, psutil.Process(pid).create_time())

    def __str__(self) -> str:
        since = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(self.started))
        return f"process {self.pid} on {self.host}, since {since}"

    def is_gone(self) -> bool:
        """Whether it ran on this machine and does not any more. Of others nothing is known.

        Its number alone says little: the machine gives it to a later process.
        """
        if self.host != socket.gethostname():
            return False
        try:
            other = abs(psutil.Process(self.pid).create_time() - self.started) > CLOCK_STEP
        except psutil.NoSuchProcess:
            return True
        return other or not works(self.pid)


def end_with(parent: int) -> None:
    """Let the kernel kill this process as soon as the one that started it is gone, however that
    ended: nobody reads any more what it makes. Linux only; elsewhere it works to its end.

    parent : its number, as this process was told when it began: the kernel tells nobody of a parent
        that was gone before it was asked, and by then this process has another
    """
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(SET_PARENT_DEATH_SIGNAL, signal.SIGKILL)
        if not works(parent):
            os.kill(os.getpid(), signal.SIGKILL)


def end_with_raylet() -> None:
    """Let this Ray worker end with its Ray: busy, it would not see for long that this is gone."""
    end_with(int(os.environ["RAY_RAYLET_PID"]))


def works(pid: int) -> bool:
    """Whether a process of this number is there and has not ended."""
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def those_with(variable: str, value: str) -> list[psutil.Process]:
    """The processes of this machine and user whose environment had this when they began."""
    found = []
    for process in psutil.process_iter():
        with contextlib.suppress(psutil.Error):  # gone by now, or another user's
            if process.environ().get(variable) == value:
                found.append(process)
    return found


def end_those_with(variable: str, value: str) -> None:
    """Kill `those_with` this, and return when they are gone."""
    killed = those_with(variable, value)
    for process in killed:
        with contextlib.suppress(psutil.NoSuchProcess):
            process.kill()
    last = time.monotonic() + KILLED_SECONDS
    while any(works(process.pid) for process in killed) and time.monotonic() < last:
        time.sleep(0.01)
