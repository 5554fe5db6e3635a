"""The container of binary glTF 2.0: its JSON, its buffers, and the numbers that lie in them."""

import base64
import json
import struct
from typing import Any
from urllib.parse import unquote

import numpy as np

from tactile_core.dataset.sources.polygons import check_number
from tactile_core.errors import TactileError

PACKED = {
    "KHR_draco_mesh_compression": "Draco",
    "EXT_meshopt_compression": "meshopt",
    "KHR_meshopt_compression": "meshopt",
}
TYPES = {5120: "i1", 5121: "u1", 5122: "i2", 5123: "u2", 5125: "u4", 5126: "f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}

LONGEST_JSON = 64 << 20  # bytes, for it takes 20 times as much when read

Json = dict[str, Any]


def open_glb(data: bytes) -> "GlbFile":
    """The document of a GLB file's bytes; raises `TactileError` as `read_glb` does."""
    return GlbFile(*_chunks(data))


def packed(name: str) -> str:
    """Why a file that is packed in this way is not read."""
    return f"is packed with {PACKED[name]}, which is not read: export it without compression"


def _chunks(data: bytes) -> tuple[Json, bytes]:
    """The JSON and the binary chunk, which may be missing."""
    if len(data) < 20 or data[:4] != b"glTF":
        raise TactileError("cannot be read as GLB (it does not begin as one)")
    version, length = struct.unpack_from("<II", data, 4)
    if version != 2:
        raise TactileError(f"is a GLB of version {version}, and only 2 is read")
    if length > len(data):
        raise TactileError(f"has {len(data)} of {length} bytes: it is cut off")
    at = 12
    chunks: dict[bytes, bytes] = {}
    while at + 8 <= length:
        size, kind = struct.unpack_from("<I4s", data, at)
        if at + 8 + size > length:
            raise TactileError("is cut off: its last chunk is longer than the file")
        chunks.setdefault(kind, data[at + 8 : at + 8 + size])
        at += 8 + size
    if b"JSON" not in chunks:
        raise TactileError("cannot be read as GLB (it has no JSON)")
    if len(chunks[b"JSON"]) > LONGEST_JSON:
        raise TactileError(f"has more than {LONGEST_JSON >> 20} MiB of JSON")
    document = json.loads(chunks[b"JSON"])
    if not isinstance(document, dict):
        raise TactileError("cannot be read as GLB (its JSON is no object)")
    return document, chunks.get(b"BIN\0", b"")


class GlbFile:
    """A document with its buffers; each is decoded once."""

    def __init__(self, document: Json, binary: bytes) -> None:
        self.document = document
        self.binary = binary
        self.decoded: dict[int, bytes] = {}

    def item(self, kind: str, number: int) -> Json:
        items = self.document.get(kind, [])
        if not 0 <= number < len(items):
            raise TactileError(f"is broken: it names {kind} {number} and has {len(items)}")
        return items[number]

    def accessor(self, number: int, exact: bool = False) -> np.ndarray:
        """The values (n, width) of an accessor, as float64, or as stored where `exact`."""
        accessor = self.item("accessors", number)
        kind, width = np.dtype("<" + TYPES[accessor["componentType"]]), WIDTHS[accessor["type"]]
        count = accessor["count"]
        check_number(count // 3)
        if "bufferView" in accessor:
            values = self._view(accessor, kind, count, width)
        else:
            values = np.zeros((count, width), dtype=kind)
        if sparse := accessor.get("sparse"):
            values = values.copy()
            index = sparse["indices"]
            index_kind = np.dtype("<" + TYPES[index["componentType"]])
            places = self._view(index, index_kind, sparse["count"], 1)[:, 0]
            if len(places) and places.max() >= count:
                raise TactileError("is broken: a sparse accessor replaces what is not there")
            values[places] = self._view(sparse["values"], kind, sparse["count"], width)
        if exact:
            return values
        numbers = values.astype(np.float64)
        if accessor.get("normalized") and kind.kind in "iu":
            numbers = np.maximum(numbers / np.iinfo(kind).max, -1)
        return numbers

    def _view(self, owner: Json, kind: np.dtype, count: int, width: int) -> np.ndarray:
        """`count` rows (n, width) of a buffer view."""
        view = self.item("bufferViews", owner["bufferView"])
        for name in PACKED:
            if name in view.get("extensions", {}) and self._is_empty(view):
                raise TactileError(packed(name))
        buffer = self._buffer(view["buffer"])
        start = view.get("byteOffset", 0) + owner.get("byteOffset", 0)
        step = view.get("byteStride") or kind.itemsize * width
        end = start + step * (count - 1) + kind.itemsize * width if count else start
        limit = min(len(buffer), view.get("byteOffset", 0) + view["byteLength"])
        if min(start, step, count) < 0 or end > limit:
            raise TactileError("is cut off: a buffer has fewer numbers than are announced")
        return np.ndarray((count, width), kind, buffer, start, (step, kind.itemsize))

    def _is_empty(self, view: Json) -> bool:
        """Whether a view's buffer is the place only where something is to be unpacked."""
        buffer = self.item("buffers", view["buffer"])
        return "uri" not in buffer and (view["buffer"] > 0 or not self.binary)

    def _buffer(self, number: int) -> bytes:
        buffer = self.item("buffers", number)
        address = buffer.get("uri")
        if address is None:
            if number:
                raise TactileError(f"is broken: buffer {number} is nowhere")
            return self.binary
        if not address.startswith("data:"):
            raise TactileError(f"keeps its geometry in another file, {address[:80]!r}: join them")
        if number not in self.decoded:
            self.decoded[number] = base64.b64decode(unquote(address.partition(",")[2]))
        return self.decoded[number]
