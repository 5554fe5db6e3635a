"""A place in an object store that one process at a time may work in, whatever machine it is on.

No system holds a lock there, that ends with the process. So an object says who works, is written
anew while that goes on, and counts no longer once it has stayed the same for `ENDS`, or for
`UNKNOWN` where its process is gone from this machine.
"""

import _thread
import contextlib
import json
import threading
import time
import uuid
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field

from upath import UPath

from tactile_core.addresses import one_line
from tactile_core.errors import TactileError
from tactile_core.files import content_hash
from tactile_core.processes import Worker

RENEWED = 15.0  # seconds between two writings
ENDS = 120.0  # seconds without one
# Seconds without one where no such process is found on this machine: another may have its name.
UNKNOWN = 40.0
SETTLED = 2.0  # seconds until nobody takes away the new claim in place of a dead one before it
POLL = 2.0  # seconds


@dataclass(frozen=True)
class Claim:
    """What the object says: who works there, and as which process."""

    name: str
    worker: Worker = field(default_factory=Worker.here)
    mark: str = field(default_factory=lambda: uuid.uuid4().hex)
    renewals: int = 0

    def renewed(self) -> "Claim":
        return Claim(self.name, self.worker, self.mark, self.renewals + 1)

    def to_bytes(self) -> bytes:
        return json.dumps(asdict(self)).encode()

    @classmethod
    def from_bytes(cls, data: bytes) -> "Claim":
        try:
            values = json.loads(data)
            return cls(**{**values, "worker": Worker(*values["worker"])})
        except (ValueError, KeyError, TypeError):  # damaged: nobody renews it
            return cls("another", Worker("nowhere", 0, 0.0), content_hash(data))


@contextlib.contextmanager
def leased(lock: UPath, name: str, waits: Callable[[str], None]) -> Iterator[None]:
    """Hold the claim that the object `lock` stands for; whoever comes meanwhile waits.

    name : says who works there, to those who wait
    waits : is told in one sentence for whom this process waits, if it does

    A process that could not renew its claim, as one that was stopped for minutes, is interrupted:
    another may be at work. Raises `TactileError` where the store cannot be written to.
    """
    claim = _take(lock, Claim(name), waits)
    over = threading.Event()
    renewal = threading.Thread(target=_renew, args=(lock, claim, over), daemon=True)
    renewal.start()
    try:
        yield
    finally:
        over.set()
        renewal.join()
        with contextlib.suppress(Exception):  # the store is gone: the claim ends by itself
            if _is_ours(lock, claim):
                lock.unlink()


def _take(lock: UPath, claim: Claim, waits: Callable[[str], None]) -> Claim:
    seen, since, told = None, 0.0, False
    while True:
        # The answer to a creation may be lost, and asked for again: then it is there, and ours.
        if _created(lock, claim) or _is_ours(lock, claim):
            time.sleep(SETTLED)
            if _is_ours(lock, claim):
                return claim
        holder = _holder(lock)
        if holder is None:
            continue
        if holder != seen:
            seen, since = holder, time.monotonic()
        if time.monotonic() - since > (UNKNOWN if holder.worker.is_gone() else ENDS):
            if _holder(lock) == holder:
                lock.unlink(missing_ok=True)
            continue
        if not told:
            waits(f"waits until {holder.name} is done in {lock.parent}")
            told = True
        time.sleep(POLL)


def _renew(lock: UPath, claim: Claim, over: threading.Event) -> None:
    last = time.monotonic()
    while not over.wait(RENEWED):
        with contextlib.suppress(Exception):  # a store that does not answer may do so next time
            if not _is_ours(lock, claim):
                break
            claim = claim.renewed()
            lock.fs.pipe_file(lock.path, claim.to_bytes())
            last = time.monotonic()
        if time.monotonic() - last > ENDS - RENEWED:
            break
    else:
        return
    _thread.interrupt_main()


def _created(lock: UPath, claim: Claim) -> bool:
    """Whether the object was made by this call, and not there before."""
    try:
        lock.fs.pipe_file(lock.path, claim.to_bytes(), mode="create")
    except FileExistsError:
        return False
    except Exception as error:  # every fsspec file system has errors of its own
        raise TactileError(
            f"{lock.parent} cannot be written to ({one_line(error)}): mend that or name another"
        ) from error
    return True


def _holder(lock: UPath) -> Claim | None:
    """Who works there; None where nobody does any more."""
    lock.fs.invalidate_cache()
    try:
        return Claim.from_bytes(lock.fs.cat_file(lock.path))
    except FileNotFoundError:
        return None
    except Exception as error:  # every fsspec file system has errors of its own
        raise TactileError(f"{lock} cannot be read ({one_line(error)}): mend that") from error


def _is_ours(lock: UPath, claim: Claim) -> bool:
    holder = _holder(lock)
    return holder is not None and holder.mark == claim.mark
