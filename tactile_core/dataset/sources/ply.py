"""PLY, text and binary of both byte orders: vertices, polygons and triangle strips."""

import re
from array import array
from typing import Literal

import numpy as np

from tactile_core.dataset.sources.elements import (
    WHAT,
    Column,
    Element,
    Property,
    Table,
    by_words,
    missing,
)
from tactile_core.dataset.sources.polygons import check_number, strips, triangles
from tactile_core.dataset.sources.text import as_ascii, gathered, rows, starts, whole
from tactile_core.errors import TactileError

TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4",
    "float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2",
    "int32": "i4", "uint32": "u4", "int64": "i8", "uint64": "u8", "float32": "f4",
    "float64": "f8",
}  # fmt: skip
BYTE_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
CORNERS = ("vertex_indices", "vertex_index", "vertex_indexes")
END = re.compile(rb"[\r\n][ \t]*end_header[ \t]*(?:\r\n|\r|\n|$)")
LONGEST_HEADER = 4 << 20  # bytes


def read_ply(data: bytes) -> tuple[np.ndarray, np.ndarray]:
    """The vertices (V, 3) float64 and triangles (F, 3) int64 of a PLY file's bytes.

    Raises `TactileError` with a reason that does not name the file, also where a vertex or face
    that the header announces is missing.
    """
    data = as_ascii(data)
    end = END.search(data)
    if not data.startswith(b"ply") or end is None:
        raise TactileError("cannot be read as PLY (it has no whole header)")
    if end.start() > LONGEST_HEADER:
        raise TactileError(f"has a header of more than {LONGEST_HEADER >> 20} MiB")
    byte_order, elements = _header(data[: end.start()].decode("latin-1"))
    body = end.end()
    if re.match(rb"ply *\r[^\n]", data) and end[0].endswith(b"\r\n"):
        body -= 1  # lines end in \r, and the first number begins with a byte as \n
    names = [element.name for element in elements]
    if again := next((name for name in WHAT if names.count(name) > 1), None):
        raise TactileError(f"has its {WHAT[again]} in several elements, which are not read")
    columns = _binary_columns if byte_order else _text_columns
    table = columns(data[body:], byte_order, elements)

    vertices = np.empty((0, 3))
    if "vertex" in table:
        missing = {"x", "y", "z"} - set(table["vertex"])
        if missing:
            raise TactileError(f"has vertices without {', '.join(sorted(missing))}")
        xyz = [table["vertex"][axis].values for axis in "xyz"]
        vertices = np.stack(xyz, axis=1).astype(np.float64)
    faces = [np.empty((0, 3), dtype=np.int64)]
    for name, cut in (("face", triangles), ("tristrips", _strips)):
        if name in table and (element := table[name]):
            corners = next((element[c] for c in CORNERS if c in element), None)
            if corners is None:
                raise TactileError(f"has {WHAT[name]} without vertex_indices")
            if len(corners.counts):
                faces.append(cut(vertices, corners.counts, whole(corners.values)))
    known = {"vertex", "face", "tristrips", "edge"}
    lists = [e.name for e in elements if e.lists]
    others = [name for name in lists if name not in known]
    if others and not sum(map(len, faces)):
        raise TactileError(f"has no faces (and elements that are not read: {', '.join(others)})")
    polygons = [name for name in others if not {*CORNERS}.isdisjoint(table[name])]
    if polygons:
        raise TactileError(f"has faces in elements that are not read: {', '.join(polygons)}")
    return vertices, np.concatenate(faces)


def _strips(vertices: np.ndarray, counts: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Several strips as one: each ends in -1."""
    return strips(np.insert(corners, np.cumsum(counts), -1))


def _header(text: str) -> tuple[str, list[Element]]:
    """The byte order and what the file holds, in its order."""
    byte_order: str | None = None
    elements: list[Element] = []
    for line in re.split(r"\r\n|\r|\n", text)[1:]:
        words = line.split()
        try:
            if not words or words[0] in ("comment", "obj_info"):
                continue
            if words[0] == "format":
                byte_order = BYTE_ORDERS[words[1]]
            elif words[0] == "element":
                if not words[2].isdigit():
                    raise ValueError(words[2])
                elements.append(Element(words[1], int(words[2]), []))
            elif words[:2] == ["property", "list"]:
                listed = Property(words[4], TYPES[words[3]], _integer(words[2]))
                elements[-1].properties.append(listed)
            elif words[0] == "property":
                elements[-1].properties.append(Property(words[2], TYPES[words[1]], None))
            else:
                raise KeyError(words[0])
        except (KeyError, IndexError, ValueError) as error:
            raise TactileError(f"has a header line that is not known: {line[:60]!r}") from error
    if byte_order is None:
        raise TactileError("has a header without format")
    return byte_order, elements


def _integer(name: str) -> str:
    if "float" in name or "double" in name:
        raise KeyError(name)
    return TYPES[name]


def _text_columns(body: bytes, byte_order: str, elements: list[Element]) -> Table:
    """A row has a line of its own and, where that does not go up, all the numbers it needs."""
    counts, values = rows(body, "line")
    try:
        return _by_lines(counts, values, elements)
    except TactileError as error:
        try:
            return by_words(values, elements)
        except TactileError as other:
            raise (error if _keeps_to_lines(counts, elements) else other) from None


def _keeps_to_lines(counts: np.ndarray, elements: list[Element]) -> bool:
    """Whether the first row stands on its line, alone: then so should the others."""
    first = next((element for element in elements if element.number and element.properties), None)
    return first is None or first.lists or not len(counts) or counts[0] == len(first.properties)


def _by_lines(counts: np.ndarray, values: np.ndarray, elements: list[Element]) -> Table:
    begins = starts(counts)
    table = {}
    line = 0
    for element in elements:
        last = line + (element.number if element.properties else 0)
        at, ends = begins[line:last], (begins + counts)[line:last]
        columns = {}
        for name, _, count_type in element.properties:
            lengths = np.ones(len(at), dtype=np.int64)
            if count_type is not None:
                lengths = whole(values[np.minimum(at, len(values) - 1)])
                at = at + 1
            broken = np.flatnonzero((at + lengths > ends) | (lengths < 0))
            if len(broken) and line + broken[0] + 1 == len(counts):
                raise missing(element, int(broken[0]))
            if len(broken):
                raise TactileError(
                    f"has a {element.name} with fewer numbers on its line than it announces"
                )
            columns[name] = Column(lengths, gathered(values, at, lengths))
            at = at + lengths
        if len(ends) < last - line:
            raise missing(element, len(ends))
        line = last
        table[element.name] = columns
    if more := len(counts) - line:
        raise TactileError(f"has more lines than its header announces ({more} of them)")
    return table


def _binary_columns(body: bytes, byte_order: str, elements: list[Element]) -> Table:
    table = {}
    at = 0
    for element in elements:
        if not element.properties or not element.number:
            table[element.name] = {
                p.name: Column(np.empty(0, dtype=np.int64), np.empty(0)) for p in element.properties
            }
            continue
        columns, at = _alike_rows(body, at, byte_order, element) or _other_rows(
            body, at, byte_order, element
        )
        table[element.name] = columns
    return table


def _alike_rows(
    body: bytes, at: int, byte_order: str, element: Element
) -> tuple[dict[str, Column], int] | None:
    """An element's columns and where it ends, if all its rows are as long as the first."""
    fields: list[tuple] = []
    size = 0
    for number, (_, kind, count_type) in enumerate(element.properties):
        length = 1
        if count_type is not None:
            field = np.dtype(byte_order + count_type)
            if at + size + field.itemsize > len(body):
                raise missing(element, 0)
            length = int(np.frombuffer(body, field, 1, at + size)[0])
            fields.append((f"count {number}", field))
            size += field.itemsize
        if not 0 <= length <= len(body):
            return None
        fields.append((f"values {number}", byte_order + kind, (length,)))
        size += np.dtype(kind).itemsize * length
    there = min(element.number, (len(body) - at) // size)
    table = np.frombuffer(body, np.dtype(fields), there, at)
    columns = {}
    for number, (name, _, count_type) in enumerate(element.properties):
        values = table[f"values {number}"]
        if count_type is not None and (table[f"count {number}"] != values.shape[1]).any():
            return None
        counts = np.full(there, values.shape[1], dtype=np.int64)
        columns[name] = Column(counts, values.reshape(-1))
    if there < element.number:
        if element.lists:
            return None  # later rows may be shorter
        raise missing(element, there)
    return columns, at + size * there


def _other_rows(
    body: bytes, at: int, byte_order: str, element: Element
) -> tuple[dict[str, Column], int]:
    """The same for rows of different lengths, one after the other."""
    check_number(element.number)
    order: Literal["big", "little"] = "big" if byte_order == ">" else "little"
    kinds = [
        (np.dtype(byte_order + kind), np.dtype(count_type) if count_type else None)
        for _, kind, count_type in element.properties
    ]
    found = [(array("q"), array("q")) for _ in kinds]  # where each begins, how many it has
    for row in range(element.number):
        for (begins, lengths), (kind, count_kind) in zip(found, kinds, strict=True):
            length = 1
            if count_kind is not None:
                counted = body[at : at + count_kind.itemsize]
                length = int.from_bytes(counted, order, signed=count_kind.kind == "i")
                at += count_kind.itemsize
            begins.append(at)
            lengths.append(length)
            at += kind.itemsize * length
            if length < 0 or at > len(body):
                raise missing(element, row)
    columns = {}
    octets = np.frombuffer(body, dtype=np.uint8)
    for (name, *_), (kind, _), column in zip(element.properties, kinds, found, strict=True):
        starts_at, counts = (np.array(numbers, dtype=np.int64) for numbers in column)
        values = gathered(octets, starts_at, counts * kind.itemsize).view(kind)
        columns[name] = Column(counts, values)
    return columns, at
