"""STL, text and binary: a row of triangles, each with its own three vertices."""

import re

import numpy as np

from tactile_core.dataset.sources.polygons import check_number
from tactile_core.dataset.sources.text import as_ascii, numbers, portions
from tactile_core.errors import TactileError

HEADER, RECORD = 84, 50  # bytes: 80 of text and the number of faces; a normal, corners, a colour
UNCOUNTED = (0, 0xFFFFFFFF)  # as programs leave it that write faces as they come
FACET = re.compile(rb"(?im)^ *facet\b")
VERTEX = re.compile(rb"(?im)^ *vertex +([^\n]*)")
FACET_ANYWHERE = re.compile(rb"(?i)\bfacet\s+normal\b")
# A note may follow, but no further solid.
END = re.compile(
    rb"(?i)(?:^|[\r\n])[ \t]*end ?solid\b(?![\s\S]*[\r\n][ \t]*(?:solid|facet|vertex)\b)"
)


def read_stl(data: bytes) -> tuple[np.ndarray, np.ndarray]:
    """The vertices (3 F, 3) float64 and triangles (F, 3) int64 of an STL file's bytes.

    Raises `TactileError` with a reason that does not name the file, also where faces that the
    header announces are missing.
    """
    text = as_ascii(data)
    corners = _text(text) if _is_text(text) else _binary(data)
    check_number(len(corners) // 3)
    return corners, np.arange(len(corners)).reshape(-1, 3)


def _is_text(data: bytes) -> bool:
    """Headers of binary files may begin with 'solid', too."""
    if len(data) >= HEADER and len(data) == HEADER + RECORD * _announced(data):
        return False
    head = data[:512]
    begins = head.lstrip().lower().startswith((b"solid", b"facet"))
    return b"\0" not in head and (begins or FACET_ANYWHERE.search(data[:4096]) is not None)


def _announced(data: bytes) -> int:
    return int.from_bytes(data[HEADER - 4 : HEADER], "little")


def _text(text: bytes) -> np.ndarray:
    """The corners (3 F, 3) of all solids."""
    facets = 0
    vertices = [np.empty((0, 3))]
    for piece in portions(text):
        facets += len(FACET.findall(piece))
        lines = b"\n".join(VERTEX.findall(piece))
        if lines:
            counts, values = numbers(lines, "vertex")
            if (counts[:-1] < 3).any():
                raise TactileError("has a vertex with fewer than three numbers")
            if (counts != 3).any():
                break  # in the last line; that the file is cut off shows below
            vertices.append(values.reshape(-1, 3))
    corners = np.concatenate(vertices)
    if END.search(text[-1000:]) is None:
        raise TactileError(f"has {len(corners) // 3} faces and no end: it is cut off")
    if len(corners) != 3 * facets:
        raise TactileError(f"has {len(corners)} vertices for {facets} faces, not three for each")
    return corners


def _binary(data: bytes) -> np.ndarray:
    """The corners (3 F, 3) of a binary file."""
    if len(data) < HEADER:
        raise TactileError(f"cannot be read as STL (it is no text, and has only {len(data)} bytes)")
    announced, (there, rest) = _announced(data), divmod(len(data) - HEADER, RECORD)
    if announced in UNCOUNTED:
        if rest > 4:
            raise TactileError(f"has {there} faces and a part of one: it is cut off")
        announced = there
    if there < announced:
        raise TactileError(f"has {there} of {announced} faces: it is cut off")
    spare = data[HEADER + RECORD * announced :]
    more = len(spare) // RECORD
    another = len(spare) > HEADER and len(spare) == HEADER + RECORD * _announced(spare)
    if another or (more and len(spare) % RECORD == 0 and spare.strip(b"\0 \r\n\t")):
        raise TactileError(
            f"announces {announced} faces and has room for {more} more: its number of faces is "
            "wrong, or it is several files in one"
        )
    check_number(announced)
    record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("colour", "<u2")])
    records = np.frombuffer(data, record, announced, HEADER)
    with np.errstate(invalid="ignore"):  # some not-a-numbers; they are found later
        return records["corners"].reshape(-1, 3).astype(np.float64)
