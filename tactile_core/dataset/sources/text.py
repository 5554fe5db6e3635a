"""Mesh files as text: one encoding, and rows of numbers read in portions.

A portion ends with a line. What is made on the way to the numbers, several times the text, is
made for one portion at a time.
"""

import codecs
import re
from collections.abc import Iterator

import numpy as np

from tactile_core.errors import TactileError

SPACE, NEWLINE = ord(" "), ord("\n")
PORTION = 4 << 20  # bytes
LONGEST_LINE = 16 << 20  # bytes, or so many lines that are joined
ROWS = 1 << 18
BLANKS = bytes.maketrans(b"\t\v\f", b"   ")
MARKS = {
    codecs.BOM_UTF8: None,
    codecs.BOM_UTF32_LE: "utf-32",  # begins as UTF-16 does, so it is looked at first
    codecs.BOM_UTF32_BE: "utf-32",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}
# A line that ends otherwise than in a backslash, which would join it to the next.
LINE_END = re.compile(rb"[^\\ \t\r\n][ \t]*(?:\r\n|[\r\n])")


def as_ascii(data: bytes) -> bytes:
    """Text in an encoding that agrees with ASCII: without its byte order mark, not as UTF-16."""
    for mark, encoding in MARKS.items():
        if data.startswith(mark):
            return data[len(mark) :] if encoding is None else _recoded(data, encoding)
    head = data[:64]
    for encoding, zeros, letters in (("utf-16-le", 1, 0), ("utf-16-be", 0, 1)):
        if len(head) > 7 and not any(head[zeros::2]) and all(head[letters::2]):
            return _recoded(data, encoding)
    return data


def portions(text: bytes) -> Iterator[bytes]:
    """The text in pieces of whole lines, its line ends newlines, its blanks spaces."""
    start = 0
    while start < len(text):
        found = LINE_END.search(text, start + PORTION)
        end = found.end() if found else len(text)
        if end - start > PORTION + LONGEST_LINE:
            raise TactileError(f"has a line of more than {LONGEST_LINE >> 20} MiB: is it no text?")
        piece = text[start:end].translate(BLANKS)
        if b"\r" in piece:
            piece = piece.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
        yield piece
        start = end


def rows(text: bytes, what: str, dtype: type = np.float64) -> tuple[np.ndarray, np.ndarray]:
    """How many numbers stand on each line (n,) that has any, and all of them in one row.

    Raises `TactileError`, in which `what` is what a line stands for, where a word is no number.
    """
    parts = [numbers(piece, what, dtype) for piece in portions(text)] or [numbers(b"", what)]
    counts, values = (np.concatenate(column) for column in zip(*parts, strict=True))
    return counts[counts > 0], values


def numbers(text: bytes, what: str, dtype: type = np.float64) -> tuple[np.ndarray, np.ndarray]:
    """As `rows`, of one portion, with a count for each line, be it empty.

    The numbers are float64, whatever `dtype` is, where they are not written as it says.
    """
    if not text.endswith(b"\n"):
        text += b"\n"
    letters = np.frombuffer(text, dtype=np.uint8)
    ink = letters > SPACE
    word_ends = np.flatnonzero(ink[:-1] & ~ink[1:])  # every line ends in a newline
    counts = np.diff(np.searchsorted(word_ends, np.flatnonzero(letters == NEWLINE)), prepend=0)
    values = _values(text, dtype) if len(word_ends) else np.empty(0, dtype=dtype)
    if len(values) != len(word_ends):
        values = _values(_respelt(text), np.float64)  # MATLAB writes corners as 1.0 as well
    if len(values) != len(word_ends):
        raise TactileError(
            f"has a {what} with something in it that is not a number{_culprit(text, dtype)}"
        )
    return counts, values


def starts(counts: np.ndarray) -> np.ndarray:
    """Where each line's numbers begin in the row of all numbers."""
    return np.cumsum(counts) - counts


def gathered(values: np.ndarray, begins: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """From each place in `begins` as many values as `lengths` says, all in one row."""
    found = np.empty(lengths.sum(), dtype=values.dtype)
    done = 0
    for first in range(0, len(begins), ROWS):
        begin, length = begins[first : first + ROWS], lengths[first : first + ROWS]
        places = np.repeat(begin - starts(length), length) + np.arange(length.sum())
        found[done : done + len(places)] = values[places]
        done += len(places)
    return found


def whole(values: np.ndarray) -> np.ndarray:
    """Corners, or their number, as int64; raises `TactileError` where one is no whole number."""
    with np.errstate(invalid="ignore"):  # what is too large for an index is none of a vertex
        if values.dtype.kind == "f" and not (values % 1 == 0).all():
            raise TactileError("has a face with a corner that is not a whole number")
        return values.astype(np.int64)


def _recoded(data: bytes, encoding: str) -> bytes:
    width = 4 if encoding == "utf-32" else 2
    whole = data[: len(data) // width * width]  # a text may be cut off within a letter
    try:
        return whole.decode(encoding).encode()
    except UnicodeError as error:
        raise TactileError(f"is damaged: it begins as {encoding.upper()} and is none") from error


def _values(text: bytes, dtype: type) -> np.ndarray:
    try:
        return np.fromstring(text, sep=" ", dtype=dtype)
    except ValueError:
        return np.empty(0, dtype=dtype)


def _respelt(text: bytes) -> bytes:
    """Numbers as only some programs write them: MSVC's not-a-numbers, Fortran's exponents."""
    text = re.sub(rb"\d\.#(?:QNAN|SNAN|IND)\d*", b"nan", text, flags=re.IGNORECASE)
    text = re.sub(rb"nan\(\w*\)", b"nan", text, flags=re.IGNORECASE)
    text = re.sub(rb"\d\.#INF\d*", b"inf", text, flags=re.IGNORECASE)
    return re.sub(rb"(?<=[\d.])[dD](?=[+-]?\d)", b"e", text)


def _culprit(text: bytes, dtype: type) -> str:
    """The first word that is no number, for a message."""
    for word in text.split():
        if len(_values(word, dtype)) != 1:
            shown = word[:20].decode("ascii", "replace")
            comma = re.fullmatch(rb"[+-]?\d*,\d+(e[+-]?\d+)?", word, re.IGNORECASE)
            return f" ({shown!r}{': write its comma as a point' if comma else ''})"
    return ""
