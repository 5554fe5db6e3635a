"""What a header announces, and text files that keep to it without keeping to lines."""

from array import array
from typing import NamedTuple

import numpy as np

from tactile_core.dataset.sources.polygons import check_number
from tactile_core.dataset.sources.text import gathered
from tactile_core.errors import TactileError

WHAT = {"vertex": "vertices", "face": "faces", "tristrips": "strips"}


class Property(NamedTuple):
    name: str
    type: str  # of numpy, as f4
    count_type: str | None  # of a list: what its length is written as


class Element(NamedTuple):
    name: str
    number: int
    properties: list[Property]

    @property
    def lists(self) -> bool:
        """Whether its rows may be of different lengths."""
        return any(p.count_type for p in self.properties)


class Column(NamedTuple):
    """A property's values: `counts` (n,) of each row, 1 where it is no list, and all in one row."""

    counts: np.ndarray
    values: np.ndarray


Table = dict[str, dict[str, Column]]


def by_words(values: np.ndarray, elements: list[Element]) -> Table:
    """The elements in a row of numbers, wherever their lines end.

    Raises `TactileError` where there are fewer numbers than announced, or more.
    """
    table: Table = {}
    at = 0
    for element in elements:
        read = _unlike_rows if element.lists else _alike_rows
        table[element.name], at = read(values, at, element)
    if more := len(values) - at:
        raise TactileError(f"has more numbers than its header announces ({more} of them)")
    return table


def missing(element: Element, there: int) -> TactileError:
    what = WHAT.get(element.name, f"rows of {element.name}")
    return TactileError(f"has {there} of {element.number} {what}: it is cut off")


def _alike_rows(values: np.ndarray, at: int, element: Element) -> tuple[dict[str, Column], int]:
    """An element's columns, and where it ends."""
    width = len(element.properties)
    end = at + width * element.number
    if end > len(values):
        raise missing(element, (len(values) - at) // width)
    rows = values[at:end].reshape(element.number, width)
    ones = np.ones(element.number, dtype=np.int64)
    return {p.name: Column(ones, rows[:, k]) for k, p in enumerate(element.properties)}, end


def _unlike_rows(values: np.ndarray, at: int, element: Element) -> tuple[dict[str, Column], int]:
    check_number(element.number)
    found = [(array("q"), array("q")) for _ in element.properties]  # where each begins, how many
    for row in range(element.number):
        for (begins, lengths), (_, _, count_type) in zip(found, element.properties, strict=True):
            length = 1
            if count_type is not None:
                counted = values[at] if at < len(values) else -1
                length = int(counted) if counted % 1 == 0 else -1
                at += 1
            begins.append(at)
            lengths.append(length)
            at += length
            if length < 0 or at > len(values):
                raise missing(element, row)
    columns = {}
    for (name, *_), column in zip(element.properties, found, strict=True):
        starts_at, counts = (np.array(numbers, dtype=np.int64) for numbers in column)
        columns[name] = Column(counts, gathered(values, starts_at, counts))
    return columns, at
