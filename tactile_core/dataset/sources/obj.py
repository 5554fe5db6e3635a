"""Wavefront OBJ: positions and faces, nothing else.

Silhouettes need neither normals, texture coordinates nor materials. Leaving them out reads
files as ShapeNet's about twice as fast as `trimesh` does. And four things that it reads
without a word, but wrongly, are right here: relative indices count from where they stand,
an index of 0 is an error, so is a face that breaks off, and statements in capitals are read.
"""

import codecs
import re

import numpy as np

from tactile_core.dataset.sources.polygons import triangles
from tactile_core.dataset.sources.text import (
    NEWLINE,
    SPACE,
    as_ascii,
    numbers,
    portions,
    starts,
    whole,
)
from tactile_core.errors import TactileError

# MSVC writes numbers that are none as 1.#QNAN, and there # begins no comment.
COMMENT = re.compile(rb"#(?:(?<!\d\.#)|(?!QNAN|SNAN|IND|INF))[^\n]*")
CONTINUED = re.compile(rb"^ *[vVfF](?=[ \\])(?:[^\n]*\\\n)+", flags=re.MULTILINE)
# Statements that hold geometry of other kinds: free-form surfaces, other files, and old patches.
UNREAD = (b"surf", b"call", b"fo", b"bsp", b"bzp", b"cdc", b"cdp")
NONE = np.empty(0, dtype=np.int64)
SMALL = 0x20  # the bit by which small letters differ from capitals
UNREAD_BEGIN = [word[0] << 8 | word[1] for word in UNREAD]


def read_obj(data: bytes) -> tuple[np.ndarray, np.ndarray]:
    """The vertices (V, 3) float64 and triangles (F, 3) int64 of an OBJ file's bytes.

    Polygons are cut into triangles; faces of fewer than three corners are left out. Raises
    `TactileError` with a reason that does not name the file. Whether the vertices are finite is
    not looked at.
    """
    text = as_ascii(data).removesuffix(b"\0").removesuffix(b"\x1a")  # the latter ends DOS's files
    vertices, counts, corners, read_so_far = [np.empty((0, 3))], [NONE], [NONE], 0
    if b"f" not in text and b"F" not in text:  # whatever else there is
        return vertices[0], NONE.reshape(0, 3)
    for piece in portions(text):
        piece_vertices, piece_counts, piece_corners = _read_portion(piece, read_so_far)
        vertices.append(piece_vertices)
        counts.append(piece_counts)
        corners.append(piece_corners)
        read_so_far += len(piece_vertices)
    all_vertices = np.concatenate(vertices)
    faces = triangles(all_vertices, np.concatenate(counts), np.concatenate(corners))
    if len(faces) and (faces.min() < 0 or faces.max() >= read_so_far):
        raise TactileError(f"has a face with a vertex that does not exist (of {read_so_far})")
    return all_vertices, faces


def _read_portion(text: bytes, read_so_far: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices (v, 3), each face's number of corners (f,) and all corners (c,) of some lines,
    `read_so_far` vertices before them."""
    letters = _letters(text)
    ends = np.flatnonzero(letters == NEWLINE)
    begins = np.concatenate([[0], ends[:-1] + 1])
    _check_statements(letters, begins)
    spaced = letters[np.minimum(begins + 1, ends)] <= SPACE  # a letter alone is a line, too
    vertex_lines = spaced & (letters[begins] | SMALL == ord("v"))
    face_lines = spaced & (letters[begins] | SMALL == ord("f"))
    letters[begins] = SPACE  # what is left of these lines is numbers
    lengths = ends + 1 - begins

    vertices, counts_of_faces, corners = np.empty((0, 3)), NONE, NONE
    if vertex_lines.any():
        lines = letters[np.repeat(vertex_lines, lengths)].tobytes()
        counts, coordinates = numbers(lines, "vertex")
        if counts.min() < 3:
            raise TactileError("has a vertex with fewer than three numbers (is the file cut off?)")
        # Colours or a weight may follow the three coordinates.
        vertices = coordinates[starts(counts)[:, None] + np.arange(3)]
    if face_lines.any():
        lines = letters[np.repeat(face_lines, lengths)].tobytes()
        _check_last_line(text)
        if b"/" in lines:  # vertex/texture/normal
            lines = re.sub(rb"/\S*", b"", lines)
        counts_of_faces, corners = numbers(lines, "face", np.int64)
        corners = whole(corners)
        if (corners == 0).any():
            raise TactileError("has a face with a vertex that does not exist (OBJ counts from 1)")
        # OBJ counts from 1, or back from the last vertex read so far.
        before = np.repeat(read_so_far + np.cumsum(vertex_lines)[face_lines], counts_of_faces)
        corners = np.where(corners > 0, corners - 1, corners + before)
    return vertices, counts_of_faces, corners


def _letters(text: bytes) -> np.ndarray:
    """A portion as uint8, without comments, continuations and indents, ending a line."""
    if codecs.BOM_UTF8 in text:  # a second one, or of files that were joined
        text = text.replace(codecs.BOM_UTF8, b"")
    text = COMMENT.sub(b"", text)
    if b"\0" in text:
        raise TactileError("holds bytes of zero: it is damaged, or no text")
    if b"\\\n" in text:
        text = CONTINUED.sub(lambda lines: lines[0].replace(b"\\\n", b" "), text)
    text = b"\n" + text + b"\n"
    if b"\n " in text:
        text = re.sub(rb"\n +", b"\n", text)
    return np.frombuffer(bytearray(text), dtype=np.uint8)


def _check_statements(letters: np.ndarray, begins: np.ndarray) -> None:
    small = letters | SMALL
    begin = small[begins].astype(np.uint16) << 8 | small[np.minimum(begins + 1, len(letters) - 1)]
    for place in begins[np.isin(begin, UNREAD_BEGIN)]:
        word = letters[place : place + 5].tobytes().split(b" ")[0]
        if word.lower() in UNREAD:
            raise TactileError(f"has the statement {word.decode()!r}, which is not read")


def _check_last_line(text: bytes) -> None:
    """A file may end without a newline, but not within a face.

    Faces of fewer than three corners are left out elsewhere; at such an end, they and a last
    corner that has fewer parts than the first one tell that the rest is missing.
    """
    last = COMMENT.sub(b"", text[text.rfind(b"\n") + 1 :]).split()
    if not last or last[0].lower() != b"f":
        return
    if len(last) < 4:
        raise TactileError("has a face with fewer than three numbers (is the file cut off?)")
    if _parts(last[1]) != _parts(last[-1]):
        raise TactileError("ends within the corner of a face (is the file cut off?)")


def _parts(corner: bytes) -> list[bool]:
    """Which of vertex, texture and normal a corner names."""
    return [bool(part) for part in corner.split(b"/")]
