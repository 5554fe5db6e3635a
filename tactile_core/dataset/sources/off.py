"""OFF, as Geomview defines it: text and binary, with colours, normals or texture beside it."""

import re
from array import array

import numpy as np

from tactile_core.dataset.sources.elements import Element, Property, by_words
from tactile_core.dataset.sources.polygons import check_number, triangles
from tactile_core.dataset.sources.text import as_ascii, gathered, rows, starts, whole
from tactile_core.errors import TactileError

# ModelNet glues the first count to the word: OFF8 6 0.
HEADER = re.compile(
    rb"(?:\s|#[^\n\r]*[\n\r])*(ST)?(C)?(N)?(4)?(n)?(?:OFF|off)(?:[ \t]*(BINARY)[^\n]*\n)?"
)
COMMENT = re.compile(rb"#[^\n\r]*")


def read_off(data: bytes) -> tuple[np.ndarray, np.ndarray]:
    """The vertices (V, 3) float64 and triangles (F, 3) int64 of an OFF file's bytes.

    Raises `TactileError` with a reason that does not name the file, also where a vertex or face
    that the header announces is missing.
    """
    data = as_ascii(data)
    header = HEADER.match(data)
    if header is None:
        raise TactileError("cannot be read as OFF (it does not begin with OFF)")
    if header[5] == b"n":
        raise TactileError("is an nOFF, of any number of dimensions, which is not read")
    body = data[header.end() :]
    flags = tuple(bool(part) for part in header.groups()[:4])
    if header[6]:
        vertices, counts, corners = _binary(body, flags)
    else:
        vertices, counts, corners = _text(COMMENT.sub(b"", body), flags)
    vertices = vertices.astype(np.float64)
    if header[4]:  # homogeneous
        with np.errstate(divide="ignore", invalid="ignore"):
            vertices = vertices / vertices[:, 3:4]
    return vertices[:, :3], triangles(vertices[:, :3], counts, corners)


# Vertices (V, 3) or wider, each face's number of corners (f,) and all corners (c,).
Read = tuple[np.ndarray, np.ndarray, np.ndarray]


def _text(body: bytes, flags: tuple[bool, ...]) -> Read:
    """Each vertex and face has a line of its own and, where that does not go up, all the numbers
    that it needs."""
    counts, values = rows(body, "line")
    if counts.sum() < 2:
        raise TactileError("cannot be read as OFF (its header has no number of vertices and faces)")
    announced, faces_announced = (int(count) for count in values[:2])
    _check_announced(announced, faces_announced)
    texture, colour, normal, homogeneous = flags
    width = 3 + homogeneous
    full = width + 3 * normal + 4 * colour + 2 * texture
    try:
        return _by_lines(counts, values, announced, faces_announced, width)
    except TactileError as error:
        head = counts[0] if counts[0] in (2, 3) else 3
        kept = head == counts[0] and (len(counts) < 2 or width <= counts[1] < 2 * full)
        for number in (full, full - 1) if colour else (full,):  # with or without transparency
            elements = [
                Element("vertex", announced, [Property(str(k), "f8", None) for k in range(number)]),
                Element("face", faces_announced, [Property("corners", "i4", "i4")]),
            ]
            try:
                table = by_words(values[head:], elements)
            except TactileError as other:
                error = error if kept else other
                continue
            corners = table["face"]["corners"]
            vertices = np.stack([table["vertex"][str(k)].values for k in range(width)], axis=1)
            return vertices, corners.counts, whole(corners.values)
        raise error from None


def _by_lines(
    counts: np.ndarray, values: np.ndarray, announced: int, faces_announced: int, width: int
) -> Read:
    if counts[0] not in (2, 3):
        raise TactileError("cannot be read as OFF (its header has no number of vertices and faces)")
    check_number(min(faces_announced, len(counts)))
    begins = starts(counts)
    at, there = begins[1 : announced + 1], counts[1 : announced + 1]
    broken = np.flatnonzero(there < width)
    if len(broken) and 1 + broken[0] + 1 < len(counts):
        raise TactileError(f"has a vertex with fewer than {width} numbers on its line")
    if len(at) - len(broken) < announced:
        raise _missing(len(at) - len(broken), announced, "vertices")
    vertices = values[at[:, None] + np.arange(width)]

    last = announced + 1 + faces_announced
    at, there = begins[announced + 1 : last], counts[announced + 1 : last]
    corners = whole(values[at])  # colours may follow
    broken = np.flatnonzero((corners < 0) | (corners >= there))
    if len(broken) and announced + 1 + broken[0] + 1 < len(counts):
        raise TactileError("has a face with fewer corners on its line than it announces")
    if len(at) - len(broken) < faces_announced:
        raise _missing(len(at) - len(broken), faces_announced, "faces")
    if more := len(counts) - last:
        raise TactileError(f"has more lines than its header announces ({more} of them)")
    return vertices, corners, whole(gathered(values, at + 1, corners))


def _binary(body: bytes, flags: tuple[bool, ...]) -> Read:
    """Big-endian: three counts, the vertices as floats, each face with its colours after it."""
    announced, faces_announced, _ = (int(count) for count in np.frombuffer(body, ">i4", 3))
    _check_announced(announced, faces_announced)
    texture, colour, normal, homogeneous = flags
    width = 3 + homogeneous + 3 * normal + 4 * colour + 2 * texture
    at = 12
    there = min(announced, (len(body) - at) // (4 * width))
    if there < announced:
        raise _missing(there, announced, "vertices")
    vertices = np.frombuffer(body, ">f4", announced * width, at).reshape(announced, width)
    at += 4 * width * announced

    words = np.frombuffer(body, ">i4", (len(body) - at) // 4, at)
    begins, lengths = array("q"), array("q")
    at = 0
    for face in range(faces_announced):
        corners = int(words[at]) if at < len(words) else -1
        colours = at + 1 + corners
        if corners < 0 or colours >= len(words) or colours + 1 + words[colours] > len(words):
            raise _missing(face, faces_announced, "faces")
        begins.append(at + 1)
        lengths.append(corners)
        at = colours + 1 + max(0, int(words[colours]))
    counts = np.array(lengths, dtype=np.int64)
    corners_of_all = gathered(words, np.array(begins, dtype=np.int64), counts)
    return vertices, counts, whole(corners_of_all)


def _check_announced(vertices: int, faces: int) -> None:
    if vertices < 0 or faces < 0:
        raise TactileError("cannot be read as OFF (its header has a negative number)")


def _missing(there: int, announced: int, what: str) -> TactileError:
    return TactileError(f"has {there} of {announced} {what}: it is cut off")
