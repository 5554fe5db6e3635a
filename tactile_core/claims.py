"""A folder, on a disk or in an object store, that one process at a time may work in, and who."""

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path

from filelock import FileLock, Timeout
from upath import UPath

from tactile_core.errors import TactileError
from tactile_core.files import is_local
from tactile_core.leases import leased

LOCK = "run.lock"  # empty while nobody works there
POLL_SECONDS = 0.5


@contextlib.contextmanager
def claimed(place: Path | UPath, name: str, waits: Callable[[str], None]) -> Iterator[None]:
    """Hold the folder `place` for the block's duration; whoever comes meanwhile waits.

    name : says who works there, to those who wait
    waits : is told in one sentence for whom this process waits, if it does

    On a disk the lock is the system's: it ends with the process that holds it, however that ends.
    Raises `TactileError` where the folder cannot be written to.
    """
    if not is_local(UPath(place)):
        with leased(UPath(place, LOCK), name, waits):
            yield
        return
    folder = Path(UPath(place).path)
    file = folder / LOCK
    lock = FileLock(file)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        try:
            lock.acquire(blocking=False)
        except Timeout:
            waits(f"waits until {file.read_text() or 'another'} is done in {folder}")
            lock.acquire(poll_interval=POLL_SECONDS)
        file.write_text(name)
    except OSError as error:
        raise TactileError(
            f"{folder} cannot be written to ({error.strerror or error}): mend that or name another"
        ) from error
    try:
        yield
    finally:
        file.write_text("")
        lock.release()
