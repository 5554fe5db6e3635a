"""One closed body, a prism of 12 sides, in every kind of file, written by hand or by trimesh."""

import json
import struct

import numpy as np
import trimesh

from tactile_core.dataset.rendering.camera import project
from tactile_core.dataset.rendering.rasteriser import rasterise
from tactile_core.dataset.sources.parsing import parse_mesh


def prism() -> tuple[np.ndarray, list[list[int]]]:
    """Vertices (24, 3), and polygons: two of 12 corners, twelve of four."""
    angles = 2 * np.pi * np.arange(12) / 12
    ring = np.stack([np.cos(angles), 0 * angles, np.sin(angles)], axis=1)
    sides = [[i, (i + 1) % 12, (i + 1) % 12 + 12, i + 12] for i in range(12)]
    return np.concatenate([ring, ring + np.array([0, 3, 0])]), [
        [*range(12)],
        [*range(12, 24)],
        *sides,
    ]


VERTICES, POLYGONS = prism()
TRIANGLES = np.array([[p[0], p[k], p[k + 1]] for p in POLYGONS for k in range(1, len(p) - 1)])
MESH = trimesh.Trimesh(VERTICES, TRIANGLES, process=False)


def mask(data: bytes, suffix: str, resolution: int = 64) -> np.ndarray:
    """The silhouette of a file's mesh."""
    mesh = parse_mesh(data, suffix)
    points = project(np.asarray(mesh.vertices), 0.0, resolution)
    return rasterise(points, np.asarray(mesh.faces), resolution)


def obj(vertices: np.ndarray = VERTICES, polygons: list | np.ndarray = TRIANGLES) -> bytes:
    text = "".join("v {:.6f} {:.6f} {:.6f}\n".format(*point) for point in vertices)
    return (text + "".join(f"f {' '.join(str(k + 1) for k in p)}\n" for p in polygons)).encode()


def text_rows(polygons: list | np.ndarray = POLYGONS) -> str:
    points = "".join("{:.6f} {:.6f} {:.6f}\n".format(*point) for point in VERTICES)
    return points + "".join(f"{len(p)} {' '.join(map(str, p))}\n" for p in polygons)


def ply_header(kind: str, elements: str = "", comment: str = "", faces: int = len(POLYGONS)) -> str:
    return (
        f"ply\nformat {kind} 1.0\n{comment}element vertex {len(VERTICES)}\n"
        "property float x\nproperty float y\nproperty float z\n"
        f"element face {faces}\nproperty list uchar int vertex_indices\n{elements}end_header\n"
    )


def ply(polygons: list | np.ndarray = POLYGONS, comment: str = "") -> bytes:
    header = ply_header("ascii", comment=comment, faces=len(polygons))
    return (header + text_rows(polygons)).encode()


def binary_ply(order: str, polygons: list | np.ndarray = POLYGONS) -> bytes:
    kind = {"<": "binary_little_endian", ">": "binary_big_endian"}[order]
    body = VERTICES.astype(order + "f4").tobytes()
    for polygon in polygons:
        body += struct.pack(f"{order}B{len(polygon)}i", len(polygon), *polygon)
    return ply_header(kind, faces=len(polygons)).encode() + body


def off(head: str = "OFF\n24 14 0\n", polygons: list | np.ndarray = POLYGONS) -> bytes:
    return (head + text_rows(polygons)).encode()


def binary_stl(header: bytes = b"", count: int | None = None) -> bytes:
    corners = VERTICES[TRIANGLES].astype("<f4")
    records = b"".join(bytes(12) + triangle.tobytes() + bytes(2) for triangle in corners)
    number = len(TRIANGLES) if count is None else count
    return header.ljust(80, b"\0") + struct.pack("<I", number) + records


def text_stl(solids: int = 1) -> bytes:
    parts = np.array_split(VERTICES[TRIANGLES], solids)
    text = ""
    for part in parts:
        text += "solid part of a vertex\n"
        for triangle in part:
            lines = "".join("  vertex {:e} {:e} {:e}\n".format(*point) for point in triangle)
            text += f"facet normal 0 0 0\n outer loop\n{lines} endloop\nendfacet\n"
        text += "endsolid part\n"
    return text.encode()


def glb(document: dict, binary: bytes) -> bytes:
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    binary += bytes(-len(binary) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text
    body += struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


KINDS = {"<f4": 5126, "<u4": 5125, "<u2": 5123, "|u1": 5121, "|i1": 5120, "<i2": 5122}
WIDTHS = {1: "SCALAR", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


def gltf(arrays: list[np.ndarray], primitives: list[dict], **document) -> tuple[dict, bytes]:
    """A document with one mesh, and its binary: `arrays` (n, width) are its accessors."""
    views, accessors, binary = [], [], b""
    for number, array in enumerate(arrays):
        binary += bytes(-len(binary) % 4)
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": array.nbytes})
        kind = {"componentType": KINDS[array.dtype.str], "type": WIDTHS[array.shape[1]]}
        accessors.append({"bufferView": number, "count": len(array)} | kind)
        binary += array.tobytes()
    whole = {
        "asset": {"version": "2.0"}, "buffers": [{"byteLength": len(binary)}],
        "bufferViews": views, "accessors": accessors, "meshes": [{"primitives": primitives}],
        "nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}], "scene": 0,
    }  # fmt: skip
    return whole | document, binary


POINTS = VERTICES.astype("<f4")
CORNERS = TRIANGLES.reshape(-1, 1).astype("<u4")
PLAIN = {"attributes": {"POSITION": 0}, "indices": 1}
