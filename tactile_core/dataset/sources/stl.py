"""STL, text and binary: a row of triangles, each with its own three vertices."""

import re

import numpy as np

from tactile_core.dataset.sources.polygons import check_number
from tactile_core.dataset.sources.text import as_ascii, numbers, portions, rows
from tactile_core.errors import TactileError

HEADER, RECORD = 84, 50  # bytes: 80 of text and the number of faces; a normal, corners, a colour
UNCOUNTED = (0, 0xFFFFFFFF)  # as programs leave it that write faces as they come
FACET = re.compile(rb"(?im)^ *facet\b")
VERTEX = re.compile(rb"(?im)^ *vertex +([^\n]*)")
# Wherever lines end. The name of a solid may have the same words in it, but no numbers after them.
NUMBER = rb"\s+(?:[-+.\d]|nan|inf)\S*"
FACET_WORDS = re.compile(rb"(?i)\bfacet\s+normal(?:%b){3}" % NUMBER)
VERTEX_WORDS = re.compile(rb"(?i)\bvertex((?:%b){3})" % NUMBER)
END_WORDS = re.compile(rb"(?i)\bend ?solid\b(?![\s\S]*\b(?:facet\s+normal|vertex)%b)" % NUMBER)
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
    """The corners (3 F, 3) of all solids, wherever their lines end."""
    facets, corners, problem = _by_lines(text)
    in_words = max(facets, len(FACET_WORDS.findall(text)))
    if problem is None and len(corners) == 3 * in_words and in_words == facets:
        if END.search(text[-1000:]) is None:
            raise TactileError(f"has {facets} faces and no end: it is cut off")
        return corners
    vertices = [match[1] for match in VERTEX_WORDS.finditer(text)]
    if END_WORDS.search(text[-1000:]) is None:
        raise TactileError(f"has {len(vertices) // 3} faces and no end: it is cut off")
    if len(vertices) != 3 * in_words:
        raise problem or TactileError(
            f"has {len(vertices)} vertices for {in_words} faces, not three for each"
        )
    return rows(b"\n".join(vertices), "vertex")[1].reshape(-1, 3)


def _by_lines(text: bytes) -> tuple[int, np.ndarray, TactileError | None]:
    """How many facets begin a line, the corners (3 F, 3) that do, and what is wrong with them."""
    facets = 0
    vertices = [np.empty((0, 3))]
    for piece in portions(text):
        facets += len(FACET.findall(piece))
        lines = b"\n".join(VERTEX.findall(piece))
        if lines:
            try:
                counts, values = numbers(lines, "vertex")
            except TactileError as error:
                return facets, vertices[0], error
            if (counts != 3).any():
                problem = TactileError("has a vertex with other than three numbers on its line")
                return facets, vertices[0], problem
            vertices.append(values.reshape(-1, 3))
    return facets, np.concatenate(vertices), None


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
