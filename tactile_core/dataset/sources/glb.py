"""Binary glTF 2.0: every triangle of its scene, where the nodes put it.

What changes the geometry is read: node transforms, instances, sparse accessors, strips and fans,
quantised positions, morph targets with their default weights, and skins as they stand. An
extension that is required and not known here is a reason, and so is one that packs positions.
Points and lines draw no silhouette and are left out; materials and animations are not looked at.
"""

import numpy as np

from tactile_core.dataset.sources.glb_file import PACKED, GlbFile, Json, open_glb, packed
from tactile_core.dataset.sources.polygons import check_number, strips
from tactile_core.errors import TactileError

INSTANCES = "EXT_mesh_gpu_instancing"
HIDDEN = "KHR_node_visibility"
READ = {INSTANCES, HIDDEN, "KHR_mesh_quantization"}
# Nothing that these say moves a vertex.
LOOKS = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "MSFT_texture_", "KHR_lights_",
         "EXT_lights_", "KHR_xmp", "KHR_animation_", "ADOBE_materials_", "AGI_", "FB_ngon_encoding",
         "EXT_mesh_features", "EXT_instance_features", "EXT_structural_metadata")  # fmt: skip
POINTS_AND_LINES, TRIANGLES, STRIP, FAN = (0, 1, 2, 3), 4, 5, 6

Mesh = list[tuple[np.ndarray, np.ndarray]]  # of each primitive: vertices (V, 3), triangles (F, 3)


def read_glb(data: bytes) -> tuple[np.ndarray, np.ndarray]:
    """The vertices (V, 3) float64 and triangles (F, 3) int64 of a GLB file's bytes.

    Raises `TactileError` with a reason that does not name the file. The geometry of one mesh that
    several nodes show is there as often.
    """
    file = open_glb(data)
    for name in file.document.get("extensionsRequired", []):
        if name in PACKED:
            raise TactileError(packed(name))
        if name not in READ and not name.startswith(LOOKS):
            raise TactileError(f"requires {name}, which is not read")
    vertices, faces = [np.empty((0, 3))], [np.empty((0, 3), dtype=np.int64)]
    before = 0
    for points, corners in Scene(file).shown():
        vertices.append(points)
        faces.append(corners + before)
        before += len(points)
    if not sum(map(len, faces)) and file.document.get("meshes"):
        raise TactileError("has no faces in the scene that it shows (points and lines draw none)")
    return np.concatenate(vertices), np.concatenate(faces)


class Scene:
    """What a file shows, and where; the matrices (4, 4) of its nodes are made once."""

    def __init__(self, file: GlbFile) -> None:
        self.file = file
        self.matrices: dict[int, np.ndarray] = {}

    def shown(self) -> Mesh:
        """Every primitive as often as the scene shows it, in the scene's coordinates."""
        found: Mesh = []
        vertices = triangles = 0
        for number in self._nodes():
            node = self.file.item("nodes", number)
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
        nodes = self.file.document.get("nodes", [])
        children = [child for node in nodes for child in node.get("children", [])]
        if self.file.document.get("scenes"):
            roots = self.file.item("scenes", self.file.document.get("scene", 0)).get("nodes", [])
        else:
            roots = sorted(set(range(len(nodes))) - set(children))
        todo = [(number, np.eye(4)) for number in reversed(roots)]
        while todo:
            number, above = todo.pop()
            if number in self.matrices:
                raise TactileError(f"is broken: node {number} has two parents")
            node = self.file.item("nodes", number)
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
            name.lower(): self.file.accessor(index)
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
        mesh = self.file.item("meshes", node["mesh"])
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
            points = self.file.accessor(attributes["POSITION"])
            for weight, target in zip(weights or [], primitive.get("targets", []), strict=False):
                if weight and "POSITION" in target:
                    points = points + weight * self.file.accessor(target["POSITION"])
            if "skin" in node:
                points = self._skinned(points, attributes, self.file.item("skins", node["skin"]))
            found.append((points, self._triangles(primitive, len(points), mode)))
        return found

    def _refuse_packed(self, primitive: Json) -> None:
        """A packed primitive can be read where a plain copy of it lies beside."""
        for name in PACKED:
            if name in primitive.get("extensions", {}):
                needed = [primitive["attributes"].get("POSITION", -1), primitive.get("indices")]
                plain = [
                    n is None or "bufferView" in self.file.item("accessors", n) for n in needed
                ]
                if not all(plain):
                    raise TactileError(packed(name))

    def _triangles(self, primitive: Json, vertices: int, mode: int) -> np.ndarray:
        if "indices" in primitive:
            corners = self.file.accessor(primitive["indices"], exact=True)[:, 0].astype(np.int64)
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
            columns = self.file.accessor(skin["inverseBindMatrices"])
            inverse = columns.reshape(-1, 4, 4).transpose(0, 2, 1)[: len(joints)]
        if any(joint not in self.matrices for joint in joints):
            raise TactileError("is broken: its scene lacks a joint of a skin")
        bones = np.stack([self.matrices[joint] for joint in joints]) @ inverse  # (J, 4, 4)
        placed = np.zeros((len(points), 3))
        total = np.zeros((len(points), 1))
        for number in range(len(attributes)):
            if f"JOINTS_{number}" not in attributes:
                break
            which = self.file.accessor(attributes[f"JOINTS_{number}"], exact=True)
            shares = self.file.accessor(attributes[f"WEIGHTS_{number}"])
            for bone, share in zip(which.T, shares.T[:, :, None], strict=True):  # (V,), (V, 1)
                m = bones[bone]
                placed += share * ((m[:, :3, :3] @ points[:, :, None])[:, :, 0] + m[:, :3, 3])
                total += share
        return placed / np.where(total > 0, total, 1)


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
