"""How far long work is and how long it will take, said often enough that it is never silent."""

import time
from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

SECONDS_BETWEEN_WORDS = 15

Say = Callable[[str], None]  # takes a sentence for the user
Item = TypeVar("Item")


def counted(
    items: Iterable[Item],
    total: int,
    say: Say,
    words: str,
    clock: Callable[[], float] = time.monotonic,
) -> Iterator[Item]:
    """The `total` items one after the other; now and then, and after the last, how many are done.

    words : what is done, as in "meshes rendered"
    """
    tell = teller(say, total, clock=clock)
    for done, item in enumerate(items, start=1):
        yield item
        tell(done, f"{done} of {total} {words}")


def teller(
    say: Say, total: float, clock: Callable[[], float] = time.monotonic
) -> Callable[[float, str], None]:
    """A function to call often with how much is done and with words for it, which says them if
    nothing was said for a while or all is done.

    The pace counts from the first call: how long it took to begin tells nothing.
    """
    said = clock()
    first: tuple[float, float] | None = None

    def tell(done: float, words: str) -> None:
        nonlocal said, first
        now = clock()
        first = first or (now, done)
        if done >= total or now - said >= SECONDS_BETWEEN_WORDS:
            said = now
            say(words + to_go(now - first[0], done - first[1], total - first[1]))

    return tell


def to_go(seconds: float, done: float, total: float) -> str:
    """How long the rest will take, as the end of a sentence, if `done` took so many seconds; ""
    where nobody can tell, or nothing is left."""
    if not 0 < done < total:
        return ""
    return f"; about {duration(seconds * (total - done) / done)} to go"


def duration(seconds: float) -> str:
    """In the unit that one would say it in: 40 s, 12 min, 2.5 h, 3.1 days."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    if seconds < 90 * 60:
        return f"{seconds / 60:.0f} min"
    if seconds < 36 * 3600:
        return f"{seconds / 3600:.1f} h"
    return f"{seconds / 86400:.1f} days"
