"""Binary glTF 2.0: every triangle of its scene, where the nodes put it.

What changes the geometry is read: node transforms, instances, sparse accessors, strips and fans,
quantised positions, morph targets with their default weights, and skins as they stand. An
extension that is required and not known here is a reason, and so is one that packs positions.
Points and lines draw no silhouette and are left out; materials and animations are not looked at.
"""

import base64
import json
import struct
from typing import Any

import numpy as np

from tactile_core.dataset.sources.polygons import check_number, strips
from tactile_core.errors import TactileError

INSTANCES = "EXT_mesh_gpu_instancing"
HIDDEN = "KHR_node_visibility"
READ = {INSTANCES, HIDDEN, "KHR_mesh_quantization"}
# Nothing that these say moves a vertex.
LOOKS = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "MSFT_texture_", "KHR_lights_",
         "EXT_lights_", "KHR_xmp", "KHR_animation_", "ADOBE_materials_", "AGI_", "FB_ngon_encoding",
         "EXT_mesh_features", "EXT_instance_features", "EXT_structural_metadata")  # fmt: skip
PACKED = {
    "KHR_draco_mesh_compression": "Draco",
    "EXT_meshopt_compression": "meshopt",
    "KHR_meshopt_compression": "meshopt",
}
TYPES = {5120: "i1", 5121: "u1", 5122: "i2", 5123: "u2", 5125: "u4", 5126: "f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
POINTS_AND_LINES, TRIANGLES, STRIP, FAN = (0, 1, 2, 3), 4, 5, 6

LONGEST_JSON = 64 << 20  # bytes, for it takes 20 times as much when read

Json = dict[str, Any]
Mesh = list[tuple[np.ndarray, np.ndarray]]  # of each primitive: vertices (V, 3), triangles (F, 3)


def read_glb(data: bytes) -> tuple[np.ndarray, np.ndarray]:
    """The vertices (V, 3) float64 and triangles (F, 3) int64 of a GLB file's bytes.

    Raises `TactileError` with a reason that does not name the file. The geometry of one mesh that
    several nodes show is there as often.
    """
    document, binary = _chunks(data)
    for name in document.get("extensionsRequired", []):
        if name in PACKED:
            raise TactileError(_packed(name))
        if name not in READ and not name.startswith(LOOKS):
            raise TactileError(f"requires {name}, which is not read")
    file = File(document, binary)
    vertices, faces = [np.empty((0, 3))], [np.empty((0, 3), dtype=np.int64)]
    before = 0
    for points, corners in file.scene():
        vertices.append(points)
        faces.append(corners + before)
        before += len(points)
    if not sum(map(len, faces)) and document.get("meshes"):
        raise TactileError("has no faces in the scene that it shows (points and lines draw none)")
    return np.concatenate(vertices), np.concatenate(faces)


def _packed(name: str) -> str:
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


class File:
    """A document with its buffers; meshes and matrices are made once."""

    def __init__(self, document: Json, binary: bytes) -> None:
        self.document = document
        self.binary = binary
        self.matrices: dict[int, np.ndarray] = {}
        self.decoded: dict[int, bytes] = {}

    def item(self, kind: str, number: int) -> Json:
        items = self.document.get(kind, [])
        if not 0 <= number < len(items):
            raise TactileError(f"is broken: it names {kind} {number} and has {len(items)}")
        return items[number]

    def scene(self) -> Mesh:
        """Every primitive as often as the scene shows it, in the scene's coordinates."""
        found: Mesh = []
        vertices = triangles = 0
        for number in self._nodes():
            node = self.item("nodes", number)
            if "mesh" not in node:
                continue
            mesh = self._mesh(node)
            for matrix in self._places(node, number):
                vertices += sum(len(points) for points, _ in mesh)
                triangles += sum(len(corners) for _, corners in mesh)
                check_number(max(vertices // 3, triangles))
                found += [(_moved(points, matrix), corners) for points, corners in mesh]
        return found

    def _nodes(self) -> list[int]:
        """The nodes of the scene, each after its parent, whose matrices are noted on the way.

        The scene is the file's default, else its first, else all nodes that have no parent.
        """
        nodes = self.document.get("nodes", [])
        children = [child for node in nodes for child in node.get("children", [])]
        if self.document.get("scenes"):
            roots = self.item("scenes", self.document.get("scene", 0)).get("nodes", [])
        else:
            roots = sorted(set(range(len(nodes))) - set(children))
        todo = [(number, np.eye(4)) for number in reversed(roots)]
        while todo:
            number, above = todo.pop()
            if number in self.matrices:
                raise TactileError(f"is broken: node {number} has two parents")
            node = self.item("nodes", number)
            if not node.get("extensions", {}).get(HIDDEN, {}).get("visible", True):
                continue
            self.matrices[number] = above @ _matrix(node)
            todo += [(child, self.matrices[number]) for child in reversed(node.get("children", []))]
        return list(self.matrices)

    def _places(self, node: Json, number: int) -> list[np.ndarray]:
        """The matrices (4, 4) at which a node shows its mesh."""
        instances = node.get("extensions", {}).get(INSTANCES)
        if "skin" in node:  # the joints hold it, wherever the node is
            return [np.eye(4)]
        if instances is None:
            return [self.matrices[number]]
        parts = {
            name.lower(): self.accessor(index)
            for name, index in instances["attributes"].items()
            if name in ("TRANSLATION", "ROTATION", "SCALE")
        }
        count = min((len(values) for values in parts.values()), default=1)
        check_number(count)
        return [
            self.matrices[number] @ _matrix({n: values[k] for n, values in parts.items()})
            for k in range(count)
        ]

    def _mesh(self, node: Json) -> Mesh:
        mesh = self.item("meshes", node["mesh"])
        weights = node.get("weights", mesh.get("weights", []))
        found = []
        for primitive in mesh["primitives"]:
            mode = primitive.get("mode", TRIANGLES)
            if mode in POINTS_AND_LINES:
                continue
            if mode not in (TRIANGLES, STRIP, FAN):
                raise TactileError(f"has a primitive of mode {mode}, which is not read")
            attributes = primitive.get("attributes", {})
            self._refuse_packed(primitive)
            if "POSITION" not in attributes:
                continue
            points = self.accessor(attributes["POSITION"])
            for weight, target in zip(weights or [], primitive.get("targets", []), strict=False):
                if weight and "POSITION" in target:
                    points = points + weight * self.accessor(target["POSITION"])
            if "skin" in node:
                points = self._skinned(points, attributes, self.item("skins", node["skin"]))
            found.append((points, self._triangles(primitive, len(points), mode)))
        return found

    def _refuse_packed(self, primitive: Json) -> None:
        """A packed primitive can be read where a plain copy of it lies beside."""
        for name in PACKED:
            if name in primitive.get("extensions", {}):
                needed = [primitive["attributes"].get("POSITION", -1), primitive.get("indices")]
                plain = [n is None or "bufferView" in self.item("accessors", n) for n in needed]
                if not all(plain):
                    raise TactileError(_packed(name))

    def _triangles(self, primitive: Json, vertices: int, mode: int) -> np.ndarray:
        if "indices" in primitive:
            corners = self.accessor(primitive["indices"], exact=True)[:, 0].astype(np.int64)
        else:
            corners = np.arange(vertices)
        check_number(len(corners) // 3)
        if len(corners) and corners.max() >= vertices:
            raise TactileError(f"has a face with a vertex that does not exist (of {vertices})")
        if mode == STRIP:
            return strips(corners)
        if mode == FAN:
            first = np.full(max(0, len(corners) - 2), corners[0] if len(corners) else 0)
            return np.stack([first, corners[1:-1], corners[2:]], axis=1)
        if len(corners) % 3:
            raise TactileError("is broken: it has triangles with fewer than three corners")
        return corners.reshape(-1, 3)

    def _skinned(self, points: np.ndarray, attributes: Json, skin: Json) -> np.ndarray:
        """Vertices (V, 3) where the joints, as they stand, put them."""
        joints = skin["joints"]
        inverse = np.tile(np.eye(4), (len(joints), 1, 1))
        if "inverseBindMatrices" in skin:
            columns = self.accessor(skin["inverseBindMatrices"])
            inverse = columns.reshape(-1, 4, 4).transpose(0, 2, 1)[: len(joints)]
        if any(joint not in self.matrices for joint in joints):
            raise TactileError("is broken: its scene lacks a joint of a skin")
        bones = np.stack([self.matrices[joint] for joint in joints]) @ inverse  # (J, 4, 4)
        placed = np.zeros((len(points), 3))
        total = np.zeros((len(points), 1))
        for number in range(len(attributes)):
            if f"JOINTS_{number}" not in attributes:
                break
            which = self.accessor(attributes[f"JOINTS_{number}"], exact=True)
            shares = self.accessor(attributes[f"WEIGHTS_{number}"])
            for bone, share in zip(which.T, shares.T[:, :, None], strict=True):  # (V,), (V, 1)
                m = bones[bone]
                placed += share * ((m[:, :3, :3] @ points[:, :, None])[:, :, 0] + m[:, :3, 3])
                total += share
        return placed / np.where(total > 0, total, 1)

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
                raise TactileError(_packed(name))
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
            self.decoded[number] = base64.b64decode(address.partition(",")[2])
        return self.decoded[number]


def _matrix(node: Json) -> np.ndarray:
    """The (4, 4) of a node, or of one instance."""
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T  # written by columns
    x, y, z, w = np.asarray(node.get("rotation", (0, 0, 0, 1)), dtype=np.float64)
    matrix = np.eye(4)
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, :3] *= np.asarray(node.get("scale", (1, 1, 1)), dtype=np.float64)
    matrix[:3, 3] = node.get("translation", (0, 0, 0))
    return matrix


def _moved(points: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    if (matrix == np.eye(4)).all():
        return points
    return points @ matrix[:3, :3].T + matrix[:3, 3]
