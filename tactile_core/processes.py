"""Processes: which one works, whether it still does, and that its helpers end with it."""

import contextlib
import ctypes
import os
import signal
import socket
import sys
import time
from pathlib import Path
from typing import NamedTuple

import psutil

SET_PARENT_DEATH_SIGNAL = 1  # Linux: prctl's PR_SET_PDEATHSIG
KILLED_SECONDS = 10  # one that was killed lets go of its memory first, on a busy machine slowly
BOOT, PROCESS = Path("/proc/sys/kernel/random/boot_id"), "/proc/{}/stat"  # Linux
STARTED = 19  # which word after the name in PROCESS is the start, in ticks since the boot


class Worker(NamedTuple):
    """A process: the machine's name, its number there, when it started (Unix time), and a mark that
    no later process of that number has, though the clock be set; "" where the system has none."""

    host: str
    pid: int
    started: float
    mark: str = ""

    @classmethod
    def here(cls) -> "Worker":
        """This process."""
        return cls.of(os.getpid())

    @classmethod
    def of(cls, pid: int) -> "Worker":
        """The process of this number on this machine."""
        return cls(socket.gethostname(), pid, psutil.Process(pid).create_time(), mark_of(pid))

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
            there = Worker.of(self.pid)
        except psutil.NoSuchProcess:
            return True
        same = there.mark == self.mark if self.mark else there.started == self.started
        return not (same and works(self.pid))


def mark_of(pid: int) -> str:
    """The boot of the machine, and the ticks from it to the start of a process; "" elsewhere than
    on Linux. Raises `psutil.NoSuchProcess`."""
    if sys.platform != "linux":
        return ""
    try:
        words = Path(PROCESS.format(pid)).read_text().rpartition(")")[2].split()
    except (FileNotFoundError, ProcessLookupError) as error:
        raise psutil.NoSuchProcess(pid) from error
    return f"{BOOT.read_text().strip()}:{words[STARTED]}"


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
