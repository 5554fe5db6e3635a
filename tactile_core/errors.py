"""The one exception that users meet: it names what is wrong, where, and what to do."""

import re

# Letters that break a line, a terminal or a file system, and bytes that are not UTF-8.
ODD = re.compile(r"[\0-\x1f\x7f-\x9f\u2028\u2029\ud800-\udfff]")


class TactileError(ValueError):
    """Bad input or settings. The message is one line that a user can act on, whatever letters the
    names in it have."""

    def __init__(self, message: str = "") -> None:
        super().__init__(spelt(message))


class OutOfReachError(TactileError):
    """A source that is not there, or does not answer: it may do so later."""


class DamagedError(TactileError):
    """A file that an asset stored is gone, or other bytes than it wrote: materialise it again."""


def spelt(text: str) -> str:
    """A text on one line: odd letters in it as Python writes them."""
    return ODD.sub(lambda letter: repr(letter[0])[1:-1], text)
