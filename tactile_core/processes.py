"""Processes: which one works, whether it still does, and that its helpers end with it."""

import ctypes
import os
import signal
import socket
import sys
import time
from typing import NamedTuple

import psutil

SET_PARENT_DEATH_SIGNAL = 1  # Linux: prctl's PR_SET_PDEATHSIG
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
            process = psutil.Process(self.pid)
            other = abs(process.create_time() - self.started) > CLOCK_STEP
            return other or process.status() == psutil.STATUS_ZOMBIE
        except psutil.NoSuchProcess:
            return True


def end_with_parent() -> None:
    """Let the kernel kill this process as soon as the one that started it is gone, however that
    ended: nobody reads any more what it makes. Linux only; elsewhere it works to its end."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(SET_PARENT_DEATH_SIGNAL, signal.SIGKILL)
