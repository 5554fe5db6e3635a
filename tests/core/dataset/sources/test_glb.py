"""GLB: what moves a vertex is read, and what is not read is a reason."""

import base64

import numpy as np
import pytest
import trimesh

from tactile_core.dataset.sources.glb import read_glb
from tactile_core.dataset.sources.parsing import parse_mesh
from tactile_core.errors import TactileError
from tests.core.dataset.sources.mesh_bytes import CORNERS, PLAIN, POINTS, TRIANGLES, glb, gltf

INSTANCES = "EXT_mesh_gpu_instancing"
DRACO, MESHOPT = "KHR_draco_mesh_compression", "EXT_meshopt_compression"


def corners(data: bytes) -> np.ndarray:
    """The corner positions of all triangles (F, 3, 3)."""
    vertices, faces = read_glb(data)
    return vertices[faces]


def refusal(data: bytes) -> str:
    with pytest.raises(TactileError) as caught:
        parse_mesh(data, ".glb")
    assert "\n" not in str(caught.value)
    return str(caught.value)


PLAIN_CORNERS = POINTS[TRIANGLES].astype(float)


def test_every_node_of_the_scene_moves_its_mesh_and_its_children():
    turn = [0, 0, np.sqrt(0.5), np.sqrt(0.5)]  # a quarter turn about z
    nodes = [
        {"children": [1, 2], "translation": [5, 0, 0], "rotation": turn},
        {"mesh": 0, "scale": [2, 1, 1]},
        {"mesh": 0, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 7, 0, 1]},
        {"mesh": 0},
    ]
    scenes = [{"nodes": [3]}, {"nodes": [0]}]
    data = glb(*gltf([POINTS, CORNERS], [PLAIN], nodes=nodes, scenes=scenes, scene=1))
    x, y, z = np.moveaxis(PLAIN_CORNERS, -1, 0)
    expected = [np.stack([5 - y, 2 * x, z], -1), np.stack([5 - (y + 7), x, z], -1)]
    np.testing.assert_allclose(corners(data), np.concatenate(expected), atol=1e-6)


def test_a_document_without_scenes_shows_all_nodes():
    document, binary = gltf([POINTS, CORNERS], [PLAIN], nodes=[{"mesh": 0}, {"mesh": 0}])
    del document["scenes"], document["scene"]
    assert len(corners(glb(document, binary))) == 2 * len(TRIANGLES)


def test_what_trimesh_writes_is_read_as_trimesh_reads_it():
    scene = trimesh.Scene([trimesh.creation.icosphere(1)])
    matrix = trimesh.transformations.rotation_matrix(1, [1, 2, 3], [3, 2, 1])
    scene.add_geometry(trimesh.creation.box(), transform=matrix)
    theirs = scene.to_geometry().triangles
    np.testing.assert_allclose(corners(scene.export(file_type="glb")), theirs, atol=1e-6)


def test_instances_are_as_many_nodes():
    moves = np.array([[0, 0, 0], [0, 6, 0]], "<f4")
    scales = np.array([[1, 1, 1], [2, 2, 2]], "<f4")
    spread = {INSTANCES: {"attributes": {"TRANSLATION": 2, "SCALE": 3, "_COLOR": 2}}}
    document, binary = gltf(
        [POINTS, CORNERS, moves, scales], [PLAIN], nodes=[{"mesh": 0, "extensions": spread}],
        extensionsRequired=[INSTANCES],
    )  # fmt: skip
    twice = [PLAIN_CORNERS, 2 * PLAIN_CORNERS + np.array([0, 6, 0])]
    np.testing.assert_allclose(corners(glb(document, binary)), np.concatenate(twice), atol=1e-6)


@pytest.mark.parametrize("base", [True, False])
def test_sparse_accessors_replace_their_values(base):
    places, values = np.arange(12, 24, dtype="<u2")[:, None], POINTS[12:] + np.float32(6)
    document, binary = gltf([POINTS, CORNERS, places, values], [PLAIN])
    if not base:  # zeros, then
        del document["accessors"][0]["bufferView"]
    document["accessors"][0]["sparse"] = {
        "count": 12, "indices": {"bufferView": 2, "componentType": 5123},
        "values": {"bufferView": 3},
    }  # fmt: skip
    expected = np.concatenate([POINTS[:12] * base, values])[TRIANGLES]
    np.testing.assert_allclose(corners(glb(document, binary)), expected)


def test_strips_and_fans_are_triangles_wound_alike():
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], "<f4")
    zigzag = np.array([[0], [1], [3], [2]], "|u1")
    fan, strip = (
        corners(glb(*gltf([square, zigzag], [primitive])))
        for primitive in (
            {"attributes": {"POSITION": 0}, "mode": 6},
            {"attributes": {"POSITION": 0}, "mode": 5, "indices": 1},
        )
    )
    for triangles in (fan, strip):
        sides = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        assert sides[:, 2].tolist() == [1, 1]


def test_points_and_lines_are_left_out_and_alone_they_are_no_mesh():
    drawn = {"attributes": {"POSITION": 0}, "mode": 1}
    dots = {"attributes": {"POSITION": 0}, "mode": 0}
    both = glb(*gltf([POINTS, CORNERS], [drawn, PLAIN, dots]))
    np.testing.assert_array_equal(corners(both), PLAIN_CORNERS)
    assert "no faces" in refusal(glb(*gltf([POINTS, CORNERS], [drawn, dots])))


def test_quantised_positions_are_what_they_stand_for():
    small = np.round(POINTS / 3 * 127).astype("|i1")
    document, binary = gltf([np.pad(small, ((0, 0), (0, 1))), CORNERS], [PLAIN])
    document["accessors"][0] |= {"type": "VEC3", "normalized": True}
    document["bufferViews"][0]["byteStride"] = 4
    document["extensionsRequired"] = ["KHR_mesh_quantization"]
    np.testing.assert_allclose(corners(glb(document, binary)), PLAIN_CORNERS / 3, atol=0.005)


def test_morph_targets_count_with_their_default_weights():
    lift = np.tile(np.array([[0, 1, 0]], "<f4"), (24, 1))
    morphed = PLAIN | {"targets": [{"POSITION": 2}, {"NORMAL": 2}]}
    document, binary = gltf([POINTS, CORNERS, lift], [morphed])
    document["meshes"][0]["weights"] = [0.5, 1]
    np.testing.assert_allclose(
        corners(glb(document, binary)), PLAIN_CORNERS + np.array([0, 0.5, 0])
    )


def test_skins_stand_where_their_joints_are():
    joints = np.zeros((24, 4), "|u1")
    joints[12:, 0] = 1
    weights = np.tile(np.array([[1, 0, 0, 0]], "<f4"), (24, 1))
    inverse = np.tile(np.eye(4, dtype="<f4").reshape(1, 16), (2, 1))
    skinned = PLAIN | {"attributes": {"POSITION": 0, "JOINTS_0": 2, "WEIGHTS_0": 3}}
    nodes = [
        {"mesh": 0, "skin": 0, "translation": [99, 0, 0]},
        {"children": [2]},
        {"translation": [0, 4, 0]},
    ]
    document, binary = gltf(
        [POINTS, CORNERS, joints, weights, inverse], [skinned], nodes=nodes,
        scenes=[{"nodes": [0, 1]}], skins=[{"joints": [1, 2], "inverseBindMatrices": 4}],
    )  # fmt: skip
    expected = np.concatenate([POINTS[:12], POINTS[12:] + np.array([0, 4, 0])])[TRIANGLES]
    np.testing.assert_allclose(corners(glb(document, binary)), expected)


def test_buffers_may_be_written_in_the_document_but_not_lie_elsewhere():
    document, binary = gltf([POINTS, CORNERS], [PLAIN])
    inside = base64.b64encode(binary).decode()
    document["buffers"][0]["uri"] = f"data:application/octet-stream;base64,{inside}"
    np.testing.assert_array_equal(corners(glb(document, b"")), PLAIN_CORNERS)
    document["buffers"][0]["uri"] = "cup.bin"
    assert "another file, 'cup.bin'" in refusal(glb(document, b""))


def packed(name: str, required: bool) -> bytes:
    document, binary = gltf([POINTS, CORNERS], [dict(PLAIN)])
    if name == DRACO:
        document["meshes"][0]["primitives"][0]["extensions"] = {DRACO: {"bufferView": 0}}
        for accessor in document["accessors"]:
            del accessor["bufferView"]
    else:
        document["buffers"].append({"byteLength": len(binary)})
        for view in document["bufferViews"]:
            view |= {"buffer": 1, "extensions": {name: {"buffer": 0}}}
    return glb(
        document | {"extensionsUsed": [name], "extensionsRequired": [name] * required}, binary
    )


@pytest.mark.parametrize("required", [True, False])
@pytest.mark.parametrize(("name", "said"), [(DRACO, "Draco"), (MESHOPT, "meshopt")])
def test_packed_geometry_is_a_reason(name, said, required):
    assert f"is packed with {said}, which is not read" in refusal(packed(name, required))


def test_required_extensions_are_known_or_a_reason_and_looks_never_are():
    looks = [
        "EXT_mesh_features",
        "FB_ngon_encoding",
        "KHR_materials_unlit",
        "KHR_texture_basisu",
        "KHR_texture_transform",
    ]
    document, binary = gltf([POINTS, CORNERS], [PLAIN], extensionsRequired=looks)
    np.testing.assert_array_equal(corners(glb(document, binary)), PLAIN_CORNERS)
    document["extensionsRequired"] = [*looks, "ACME_folded_space"]
    assert "requires ACME_folded_space, which is not read" in refusal(glb(document, binary))


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"nodes": [{"mesh": 0, "children": [0]}]}, "node 0 has two parents"),
        ({"nodes": [{"mesh": 4}]}, "it names meshes 4 and has 1"),
        ({"nodes": [{"mesh": 0}] * 2, "scenes": [{"nodes": [0, 0]}]}, "node 0 has two parents"),
        ({"scenes": [{"nodes": []}]}, "no faces in the scene"),
        (
            {"accessors": [{"count": 10**12, "componentType": 5126, "type": "VEC3"}] * 2},
            "triangles",
        ),
        ({"nodes": 7}, "cannot be read as GLB"),
        ({"meshes": [{}]}, "cannot be read as GLB"),
    ],
)
def test_a_broken_document_says_where(change, why):
    document, binary = gltf([POINTS, CORNERS], [PLAIN])
    assert why in refusal(glb(document | change, binary))


def test_a_buffer_that_is_too_short_is_told():
    document, binary = gltf([POINTS, CORNERS], [PLAIN])
    assert "fewer numbers than are announced" in refusal(glb(document, binary[:-40]))
    whole = glb(document, binary)
    assert f"has {len(whole) - 1} of {len(whole)} bytes" in refusal(whole[:-1])
