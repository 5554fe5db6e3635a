"""Wavefront OBJ: positions and faces, nothing else.

Silhouettes need neither normals, texture coordinates nor materials. Leaving them out reads
files as ShapeNet's about twice as fast as `trimesh` does. And three things that it reads
without a word, but wrongly, are right here: relative indices count from where they stand,
an index of 0 is an error, and so is a face that breaks off.
"""

import re

import numpy as np

from tactile_core.errors import TactileError

SPACE, NEWLINE = ord(" "), ord("\n")


def read_obj(data: bytes) -> tuple[np.ndarray, np.ndarray]:
    """The vertices (V, 3) float64 and triangles (F, 3) int64 of an OBJ file's bytes.

    Polygons become fans of triangles. Raises `TactileError` with a reason that does not
    name the file. Whether the vertices are finite is not looked at.
    """
    letters = _letters(data)
    ends = np.flatnonzero(letters == NEWLINE)
    starts = np.concatenate([[0], ends[:-1] + 1])
    spaced = letters[np.minimum(starts + 1, ends)] == SPACE
    vertex_lines = spaced & (letters[starts] == ord("v"))
    face_lines = spaced & (letters[starts] == ord("f"))
    if not vertex_lines.any() or not face_lines.any():
        return np.empty((0, 3)), np.empty((0, 3), dtype=np.int64)

    letters[starts] = SPACE  # what is left of these lines is numbers
    lengths = ends + 1 - starts
    counts, coordinates = _numbers(letters[np.repeat(vertex_lines, lengths)].tobytes(), "vertex")
    # Colours or a weight may follow the three coordinates.
    vertices = coordinates[_starts(counts)[:, None] + np.arange(3)]

    text = letters[np.repeat(face_lines, lengths)].tobytes()
    if b"/" in text:  # vertex/texture/normal
        text = re.sub(rb"/\S*", b"", text)
    counts, corners = _numbers(text, "face")
    # OBJ counts from 1, or back from the last vertex read so far.
    read_so_far = np.repeat(np.cumsum(vertex_lines)[face_lines], counts)
    indices = np.where(corners > 0, corners - 1, corners + read_so_far)
    if (corners == 0).any() or indices.min() < 0 or indices.max() >= len(vertices):
        raise TactileError(f"has a face with a vertex that does not exist (of {len(vertices)})")
    return vertices, _triangles(counts, indices)


def _letters(data: bytes) -> np.ndarray:
    """The text as uint8, without comments, continuations, indents and tabs, ending a line."""
    text = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n").replace(b"\t", b" ")
    text = re.sub(rb"#[^\n]*", b"", text.replace(b"\\\n", b" ")) + b"\n"
    if b"\n " in text or text.startswith(b" "):
        text = re.sub(rb"^ +", b"", text, flags=re.MULTILINE)
    return np.frombuffer(bytearray(text), dtype=np.uint8)


def _numbers(text: bytes, what: str) -> tuple[np.ndarray, np.ndarray]:
    """How many numbers stand on each line (n,), and all of them in one row."""
    letters = np.frombuffer(text, dtype=np.uint8)
    ink = letters > SPACE
    last_letters = ink[:-1] & ~ink[1:]  # every line ends in a newline
    ends = np.cumsum(last_letters)[np.flatnonzero(letters[1:] == NEWLINE)]
    counts = np.diff(ends, prepend=0)
    if counts.min() < 3:
        raise TactileError(f"has a {what} with fewer than three numbers (is the file cut off?)")
    try:
        numbers = np.fromstring(text, sep=" ", dtype=np.float64 if what == "vertex" else np.int64)
    except ValueError:
        numbers = np.empty(0)
    if len(numbers) != counts.sum():
        raise TactileError(f"has a {what} with something in it that is not a number")
    return counts, numbers


def _starts(counts: np.ndarray) -> np.ndarray:
    """Where each line's numbers begin in the row of all numbers."""
    return np.cumsum(counts) - counts


def _triangles(counts: np.ndarray, indices: np.ndarray) -> np.ndarray:
    """Polygons of `counts` corners each as fans of triangles (F, 3)."""
    if (counts == 3).all():
        return indices.reshape(-1, 3)
    fan = counts - 2
    first = np.repeat(_starts(counts), fan)
    step = np.arange(fan.sum()) - np.repeat(_starts(fan), fan)
    return indices[np.stack([first, first + step + 1, first + step + 2], axis=1)]
