"""Mesh files of all kinds to meshes of one size and place; bad ones to a reason."""

import codecs
import io
import logging
import warnings

import numpy as np
import pytest
import trimesh
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tactile_core.dataset.sources.obj import read_obj
from tactile_core.dataset.sources.parsing import parse_mesh
from tactile_core.errors import TactileError

SQUARE = b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


def corners(data: bytes) -> list:
    """The corner positions of each triangle, x and y."""
    vertices, faces = read_obj(data)
    return vertices[faces][:, :, :2].astype(int).tolist()


TWO = [[[0, 0], [1, 0], [1, 1]], [[0, 0], [1, 1], [0, 1]]]


@pytest.mark.parametrize(
    "text",
    [
        SQUARE + b"f 1 2 3\nf 1 3 4\n",
        SQUARE + b"f 1 2 3 4",  # a quad, and no newline at the end
        SQUARE + b"f 1/1/1 2/2/2 3/3/3 4/4/4\n",
        SQUARE + b"f 1//1 2//1 3//1 4//1\n",
        SQUARE + b"f 1/4 2/3 3/2 4/1\n",
        SQUARE + b"f -4 -3 -2 -1\n",
        SQUARE + b"f 1 2 3 4  # the front\n",
        SQUARE + b"f 1 2 \\\n 3 4\n",
        (SQUARE + b"f 1 2 3 4\n").replace(b"\n", b"\r\n"),
        (SQUARE + b"f 1 2 3 4\n").replace(b"\n", b"\r"),
        (SQUARE + b"f 1 2 3 4\n").replace(b"\n", b"\n \t").replace(b" 2 ", b"\t2   "),
        b"mtllib lost.mtl\no a\ng b\nusemtl c\ns off\n" + SQUARE + b"vn 0 0 1\nvt 0 0\nf 1 2 3 4",
        SQUARE.replace(b" 0\n", b" 0 1.0 0.5 0.5 0.5\n") + b"f 1 2 3 4\n",  # weights, colours
        SQUARE.replace(b"v 0 0 0", b"v 0 0 0 1") + b"f 1 2 3\nf 1 3 4\n",  # weights on some
        SQUARE.replace(b"v 1 0 0", b"v 1e0 .0 -0.0e-3") + b"f 1 2 3 4\n",
        SQUARE.replace(b"v 1 0 0", b"v 1.0d+00 0.D0 0") + b"f 1 2 3 4\n",  # as Fortran does
        codecs.BOM_UTF8 + SQUARE + b"f 1 2 3 4\n",
        (SQUARE + b"f 1 2 3 4\n").decode().encode("utf-16"),
        (SQUARE + b"f 1 2 3 4\n").decode().encode("utf-16-be"),
        (SQUARE + b"f 1 2 3 4\n").decode().encode("utf-32"),
        b"# C:\\models\\\n" + SQUARE + b"f 1 2 3 4\n",
        SQUARE + b"o C:\\a\\\nf 1 2 3\nusemtl C:\\b\\\r\nf 1 3 4\n",
        SQUARE + b"f 1 2 \\\r\n3 \\\r\n 4\r\n",
        SQUARE + b"f\\\n1 2 3 4 # a face \\\n",
        b"v \\\n0 0 0" + SQUARE.removeprefix(b"v 0 0 0") + b"f 1 2 3 4\n",
        SQUARE + b"f 1 2\nf 1 2 3\nf 4\nf 1 3 4\nf\nl 1 2 3\np 1\nf 1//1 2//2\n",
        (SQUARE + b"f 1 2 3 4\n").replace(b" ", b"\f").replace(b"\n", b"\n\v"),
        SQUARE + b"f 1 2 3 4\n\0",
        b"vt -1.#IND00 -1.#IND00\n" + SQUARE + b"f 1 2 3 4\n",
        SQUARE + b"f 1.0 2.0 3.0 4.0\n",  # as MATLAB does
        codecs.BOM_UTF8 + codecs.BOM_UTF8 + SQUARE + codecs.BOM_UTF8 + b"f 1 2 3 4\n",
        SQUARE + b"f 1//2 2//2 3//1 4//1\n",
        SQUARE + b"f 1/ 2/ 3/ 4/\nf\n",
        SQUARE.replace(b"v", b"V") + b"F 1 2 3 4\n",
        SQUARE.upper() + b"VN 0 0 1\nF 1//1 2//1 \\\n 3//1 4//1\n",
        SQUARE + b"f 1 2 3\nF 1 3 4\n",
    ],
)
def test_every_way_of_writing_two_triangles_gives_the_same_two(text):
    assert corners(text) == TWO


@pytest.mark.parametrize("portion", [1, 7, 20, 64])
@given(
    st.permutations([b"", b"# a comment \\\n", b"usemtl \\\n", b"l 1 2 \n", b"\n\n", b"f 1 2\n"])
)
@settings(max_examples=20)
def test_an_obj_is_the_same_whatever_portions_it_is_read_in(portion, between):
    lines = [*SQUARE.splitlines(keepends=True), b"f 1 \\\n2 \\\n3\n", b"f -4 -2 -1\n"]
    text = b"".join(a + b for a, b in zip(between, lines, strict=True))
    for ends in (b"\n", b"\r\n", b"\r"):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("tactile_core.dataset.sources.text.PORTION", portion)
            assert corners(text.replace(b"\n", ends)) == TWO


def test_a_vertex_that_no_face_uses_may_be_none():
    mesh = parse_mesh(SQUARE + b"v nan 0 inf\nf 1 2 3 4\n", ".obj")
    assert (len(mesh.vertices), len(mesh.faces)) == (4, 2)


def test_relative_indices_count_from_where_they_stand():
    text = b"v 9 9 9\n" + SQUARE + b"f -4 -3 -2\nf -4 -2 -1\nv 8 8 8\nv 7 7 7\n"
    assert corners(text) == TWO


def test_polygons_of_different_sizes_become_fans():
    text = b"".join(b"v %d %d 0\n" % (k, k * k) for k in range(6))
    _, faces = read_obj(text + b"f 1 2 3\nf 1 2 3 4 5\nf 3 4 5 6\n")
    assert (faces + 1).tolist() == [
        [1, 2, 3],
        [1, 2, 3],
        [1, 3, 4],
        [1, 4, 5],
        [3, 4, 5],
        [3, 5, 6],
    ]


@given(
    arrays(np.float64, (7, 3), elements=st.floats(-1e6, 1e6)),
    arrays(np.int64, (5, 3), elements=st.integers(0, 6)),
)
def test_what_trimesh_writes_is_read_back_as_trimesh_reads_it(vertices, faces):
    data = trimesh.Trimesh(vertices, faces, process=False).export(file_type="obj").encode()
    ours, theirs = read_obj(data), trimesh.load_mesh(io.BytesIO(data), "obj", process=False)
    np.testing.assert_array_equal(ours[0][ours[1]], theirs.triangles)


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"", "is empty"),
        (SQUARE, "no faces"),
        (b"\0\xffbinary\0" * 9, "no faces"),
        (SQUARE + b"f 1 2 3\n" + bytes(9), "holds bytes of zero"),
        (SQUARE + b"f 1 2 3\nf 1 2", "a face with fewer than three numbers"),
        (SQUARE + b"f 1 2 3\nf", "a face with fewer than three numbers"),  # it broke off
        (SQUARE + b"f 1/1 2/2 3/3\nf 1/1 2/2 3", "ends within the corner of a face"),
        (SQUARE + b"f 1/1/1 2/2/2 3/3/3\nf 1/1/1 2/2/2 3/3/", "ends within the corner of a face"),
        (SQUARE + b"v\nf 1 2 3\n", "a vertex with fewer than three numbers"),
        (SQUARE + b"f 1 2 3\nv 1 2", "a vertex with fewer than three numbers"),
        (SQUARE + b"v 1\nf 1 2 3\n", "a vertex with fewer than three numbers"),
        (SQUARE + b"f 1 2 5\n", r"a vertex that does not exist \(of 4\)"),
        (SQUARE + b"f 0 1 2\n", "a vertex that does not exist"),
        (SQUARE + b"f -5 -1 -2\n", "a vertex that does not exist"),
        (SQUARE + b"f 1 2 x\n", "a face with something in it that is not a number"),
        (SQUARE + b"f 1 2 3.5\n", "a face with a corner that is not a whole number"),
        (SQUARE + b"v 1 2 z\nf 1 2 3\n", "a vertex with something in it that is not a number"),
        (SQUARE + b"v 0,5 1 2\nf 1 2 3\n", "'0,5': write its comma as a point"),
        (SQUARE + b"f 1 2 99999999999999999999\n", "a vertex that does not exist"),
        (SQUARE + b"f 1 2 -99999999999999999999\n", "a vertex that does not exist"),
        (SQUARE + b"# " + b"f" * (20 << 20), "a line of more than 16 MiB"),
        (SQUARE + b"f 1 2 3\nsurf 0 1 0 1 1 2 3\n", "the statement 'surf', which is not read"),
        (SQUARE + b"F 1 2 3\nSURF 0 1 0 1 1 2 3\n", "the statement 'SURF', which is not read"),
        (SQUARE + b"F 1 2 3\nFo 1 2 3\n", "the statement 'Fo', which is not read"),
        (SQUARE + b"F 1 2 3\nF 1 2", "a face with fewer than three numbers"),
        (SQUARE + b"v nan 0 0\nf 1 2 5\n", "not a finite number"),
        (SQUARE + b"v 1.#QNAN 0 0\nf 1 2 5\n", "not a finite number"),
        (SQUARE + b"v -1.#IND00 -1.#IND 0 # none\nf 1 2 5\n", "not a finite number"),
        (SQUARE + b"v 0 1.#INF 0\nf 1 2 5\n", "not a finite number"),
        (SQUARE + b"v 0 -nan(ind) 0\nf 1 2 5\n", "not a finite number"),
        (SQUARE + b"v 0 Inf 0\nf 1 2 5\n", "not a finite number"),
        (SQUARE + b"v 0 inf 0\nf 1 2 5\n", "not a finite number"),
        (SQUARE + b"v 0 1e999 0\nf 1 2 5\n", "not a finite number"),
        (SQUARE + b"f 1 1 1\n", "no extent"),
        (SQUARE + b"f 1 1 2\nf 2 2 3\n", "no face with an area"),
        (b"v 1e200 0 0\nv -1e200 0 0\nv 0 1e200 0\nf 1 2 3", "too large"),
    ],
)
def test_an_obj_that_cannot_be_used_gives_its_reason(data, why):
    with pytest.raises(TactileError, match=why):
        parse_mesh(data, ".obj")


@pytest.mark.parametrize("encoding", ["ply", "ply ascii", "stl", "stl_ascii", "off", "glb"])
@pytest.mark.parametrize("keep", [0, 0.01, 0.5, 0.9, 0.99])
def test_a_cut_off_file_of_any_kind_gives_one_line(encoding, keep):
    kind, *ascii_ply = encoding.split()
    options = {"encoding": "ascii"} if ascii_ply else {}
    data = trimesh.creation.icosphere().export(file_type=kind, **options)
    data = data.encode() if isinstance(data, str) else data
    suffix = f".{kind.removesuffix('_ascii')}"
    assert len(parse_mesh(data, suffix).faces) == 1280
    with pytest.raises(TactileError) as caught:
        parse_mesh(data[: int(keep * len(data))], suffix)
    assert "\n" not in str(caught.value)


def exported(mesh: trimesh.Trimesh | trimesh.Scene, suffix: str) -> bytes:
    data = mesh.export(file_type=suffix[1:])
    return data.encode() if isinstance(data, str) else data


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".stl", ".off", ".glb", ".OBJ", ".STL"])
def test_every_kind_of_file_gives_the_same_mesh(suffix):
    mesh = trimesh.creation.annulus(1, 2, 3)
    mesh.apply_translation([5, 6, 7])
    parsed = parse_mesh(exported(mesh, suffix.lower()), suffix)
    expected = (mesh.triangles - [5, 6, 7]) / np.sqrt(4**2 + 4**2 + 3**2)
    np.testing.assert_allclose(parsed.triangles, expected, atol=1e-6)


def test_a_scene_of_several_bodies_keeps_each_in_its_place():
    scene = trimesh.Scene([trimesh.creation.box()])
    away = trimesh.transformations.translation_matrix([3, 0, 0])
    scene.add_geometry(trimesh.creation.box(), transform=away)
    parsed = parse_mesh(exported(scene, ".glb"), ".glb")
    assert len(parsed.faces) == 24
    np.testing.assert_allclose(parsed.extents, np.array([4, 1, 1]) / np.sqrt(18))


@given(
    arrays(np.float64, (6, 3), elements=st.floats(-1e3, 1e3)),
    st.lists(st.permutations(range(6)).map(lambda p: p[:3]), min_size=1, max_size=4),
    st.sampled_from([1e-6, 1.0, 1e6]),
)
def test_meshes_are_centred_and_have_diagonal_one_whatever_they_were(vertices, faces, scale):
    a, b, c = vertices[faces].transpose(1, 0, 2)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    assume(areas.min() > max(1, 0.01 * areas.sum()))  # a face that is a speck may be left out
    used = vertices[np.unique(faces)]
    text = "".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in (vertices * scale).tolist())
    text += "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in faces)
    mesh = parse_mesh(text.encode(), ".obj")
    np.testing.assert_allclose(mesh.vertices.min(0) + mesh.vertices.max(0), 0, atol=1e-9)
    assert np.linalg.norm(np.ptp(mesh.vertices, axis=0)) == pytest.approx(1)
    low, high = used.min(0), used.max(0)
    expected = (vertices[faces] - (low + high) / 2) / np.linalg.norm(high - low)
    np.testing.assert_allclose(mesh.vertices[mesh.faces], expected, atol=1e-6)


def test_a_material_file_that_is_missing_is_no_matter(caplog):
    text = b"mtllib lost.mtl\nusemtl red\n" + SQUARE + b"usemtl blue\nf 1 2 3\nusemtl red\nf 1 3 4"
    with caplog.at_level(logging.INFO), warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(parse_mesh(text, ".obj").faces) == 2
    assert caplog.text == ""
