"""PLY, OFF and STL as people have them: every face that is announced is read, or missed."""

import re
import struct

import numpy as np
import pytest

from tactile_core.dataset.sources.parsing import parse_mesh
from tactile_core.dataset.sources.ply import read_ply
from tactile_core.errors import TactileError
from tests.core.dataset.sources.mesh_bytes import (
    MESH,
    POLYGONS,
    TRIANGLES,
    VERTICES,
    binary_ply,
    binary_stl,
    mask,
    obj,
    off,
    ply,
    ply_header,
    text_rows,
    text_stl,
)

COMMENTS = "".join(f"comment line {k} of the story of this scan\n" for k in range(110))
WHOLE_MASK = mask(obj(), ".obj")


def refusal(data: bytes, suffix: str) -> str:
    with pytest.raises(TactileError) as caught:
        parse_mesh(data, suffix)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def without_lines(data: bytes, lines: int) -> bytes:
    return b"".join(data.splitlines(keepends=True)[:-lines])


def again(data: bytes, name: str, other: str | None = None) -> bytes:
    """A text PLY with an element once more behind the others, perhaps under another name."""
    header, end, body = data.partition(b"end_header\n")
    [declared] = re.findall(rb"element %b .*\n(?:property .*\n)+" % name.encode(), header)
    rows = int(declared.split()[2])
    lines = body.splitlines(keepends=True)
    of_name = lines[-rows:] if name == "face" else lines[:rows]
    renamed = declared.replace(name.encode(), (other or name).encode(), 1)
    return b"".join([header, renamed, end, *lines, *of_name])


def beside_vertices(head: str, more: bytes) -> bytes:
    """An OFF with `more` behind the three coordinates of each vertex."""
    return re.sub(rb"(\.\d{6})\n", rb"\1" + more + rb"\n", off(head))


BIG_OFF = VERTICES.astype(">f4").tobytes() + b"".join(
    struct.pack(f">{len(p) + 2}i", len(p), *p, k % 2) + struct.pack(">f", 0.5) * (k % 2)
    for k, p in enumerate(POLYGONS)
)
GOOD = {
    "ply": (ply(), ".ply"),
    "ply of triangles": (ply(TRIANGLES), ".ply"),
    "ply after long comments": (ply(comment=COMMENTS), ".ply"),
    "ply with CRLF": (ply().replace(b"\n", b"\r\n"), ".ply"),
    "ply with CR": (ply().replace(b"\n", b"\r"), ".ply"),
    "ply with empty lines": (ply().replace(b"0\n1", b"0\n\n1"), ".ply"),
    "ply with a mark": (b"\xef\xbb\xbf" + ply(), ".ply"),
    "ply with edges among its faces": (ply([*POLYGONS, [0, 1], [3]]), ".ply"),
    "little-endian ply": (binary_ply("<"), ".ply"),
    "big-endian ply": (binary_ply(">"), ".ply"),
    "little-endian ply of triangles": (binary_ply("<", TRIANGLES), ".ply"),
    "big-endian ply of triangles": (binary_ply(">", TRIANGLES), ".ply"),
    "binary ply with edges": (binary_ply("<", [*POLYGONS, [0, 1], []]), ".ply"),
    "binary ply with CR": (binary_ply("<").replace(b"\n", b"\r", 9), ".ply"),
    "off": (off(), ".off"),
    "off, on the line": (off("OFF 24 14 0\n"), ".off"),
    "off, glued": (off("OFF24 14 0\n"), ".off"),
    "off with long comments": (off("# made from BINARY files\n" * 400 + "OFF\n24 14 0\n"), ".off"),
    "off without edges": (off("OFF\n24 14\n"), ".off"),
    "off with comments": (off("# a\nOFF # b\n\n# 1 2 3\n24 14 0 # c\n\n"), ".off"),
    "off with a mark and CRLF": (b"\xef\xbb\xbf" + off().replace(b"\n", b"\r\n"), ".off"),
    "off with edges among its faces": (off("OFF\n24 15 0\n", [*POLYGONS, [0, 1]]), ".off"),
    "off with colours of faces": (off().replace(b" 12\n", b" 12 255 0 0\n"), ".off"),
    "coff": (beside_vertices("COFF\n24 14 0\n", b" 255 0 0 255"), ".off"),
    "noff": (beside_vertices("NOFF\n24 14 0\n", b" 0 0 1"), ".off"),
    "stoff": (beside_vertices("STOFF\n24 14 0\n", b" 0 1"), ".off"),
    "stcnoff": (beside_vertices("STCNOFF24 14 0\n", b" 0 0 1 1 1 1 1 0 0"), ".off"),
    "4off": (beside_vertices("4OFF\n24 14 0\n", b" 1"), ".off"),
    "binary off": (b"OFF BINARY\n" + struct.pack(">3i", 24, 14, 0) + BIG_OFF, ".off"),
    "binary off after a comment": (
        b"# BINARY\nOFF BINARY\n" + struct.pack(">3i", 24, 14, 0) + BIG_OFF,
        ".off",
    ),
    "stl": (binary_stl(), ".stl"),
    "stl that begins as a text": (binary_stl(b"solid exported by a program"), ".stl"),
    "stl with a byte to spare": (binary_stl() + b"\n", ".stl"),
    "stl with zeros to spare": (binary_stl() + bytes(500), ".stl"),
    "stl with a note behind": (binary_stl() + b"made by hand, " * 9, ".stl"),
    "stl, uncounted": (binary_stl(count=0), ".stl"),
    "stl, uncounted, a byte to spare": (binary_stl(count=0xFFFFFFFF) + b"\0", ".stl"),
    "text stl": (text_stl(), ".stl"),
    "text stl of several solids": (text_stl(3), ".stl"),
    "text stl with CR": (text_stl().replace(b"\n", b"\r"), ".stl"),
    "text stl with a note behind": (text_stl() + b"\n; made by hand\n", ".stl"),
    "text stl in capitals with a mark": (b"\xef\xbb\xbf" + text_stl().upper(), ".stl"),
}


@pytest.mark.parametrize("name", GOOD)
def test_every_way_of_writing_a_body_gives_its_silhouette(name):
    data, suffix = GOOD[name]
    assert len(parse_mesh(data, suffix).faces) == len(TRIANGLES)
    np.testing.assert_array_equal(mask(data, suffix), WHOLE_MASK)


def rearranged(data: bytes, lines: int, words: int) -> bytes:
    """A text whose first `lines` stay and whose other words stand `words` to a line."""
    *head, rest = data.split(b"\n", lines)
    every = rest.split()
    some = [b" ".join(every[k : k + words]) for k in range(0, len(every), words)]
    return b"\n".join([*head, *some, b""])


NORMALS = beside_vertices("NOFF\n24 14 0\n", b" 0 0 1")
COLOURS = off().replace(b" 12\n", b" 12 255 0 0\n")
VERTEX_LINES = {"ply": 9, "off": 2}  # lines before the first vertex
TEXTS = {"ply": ply(), "off": off(), "text stl": text_stl(2)}


@pytest.mark.parametrize("words", [1, 2, 6, 7, 8, 10_000])
@pytest.mark.parametrize("name", TEXTS)
def test_numbers_that_do_not_keep_to_lines_are_read(name, words):
    """One vertex over several lines, several on one line, and faces likewise."""
    data, suffix = TEXTS[name], f".{name.split()[-1]}"
    data = rearranged(data, VERTEX_LINES.get(name, 0), words)
    assert len(parse_mesh(data, suffix).faces) == len(TRIANGLES)
    np.testing.assert_array_equal(mask(data, suffix), WHOLE_MASK)


@pytest.mark.parametrize(
    "data",
    [
        NORMALS.replace(b" 0 0 1\n", b"\n0 0 1\n"),  # their number of lines is right for none
        rearranged(NORMALS, 2, 12),
        rearranged(beside_vertices("COFF\n24 14 0\n", b" 1 0 0 1"), 2, 5),
        rearranged(beside_vertices("COFF\n24 14 0\n", b" 255 0 0"), 2, 5),
        rearranged(beside_vertices("ST4OFF\n24 14 0\n", b" 1 .5 .5"), 2, 5),
        off("OFF\n24\n14\n0\n"),
        off("OFF\n24 14 0 ").replace(b"\n", b" ", 20),
    ],
)
def test_an_off_with_more_beside_its_vertices_need_not_keep_to_lines_either(data):
    np.testing.assert_array_equal(mask(data, ".off"), WHOLE_MASK)


def test_long_polygons_may_be_broken_into_lines():
    for data, suffix in ((ply(), ".ply"), (off(), ".off")):
        broken = data.replace(b"12 0 1 2 3 4", b"12 0 1 2 3 4\n")
        np.testing.assert_array_equal(mask(broken, suffix), WHOLE_MASK)


@pytest.mark.parametrize(
    ("end", "faces"),
    [
        ("\n", "9 3 0 1 2 2 .5 .5\n9 4 0 1 2 3 0\n"),
        (" ", "9 3 0 1 2 2 .5 .5 9\n4 0 1 2 3 0"),
    ],
)
def test_other_columns_and_lists_of_a_ply_are_passed_over_wherever_their_lines_end(end, faces):
    header = ply_header("ascii", faces=2).replace("float x", "int id\nproperty double x")
    header = header.replace("property list", "property uchar red\nproperty list")
    header = header.replace("end_header", "property list uchar float texcoord\nend_header")
    points = "".join("7 {:.6f} {:.6f} {:.6f}".format(*point) + end for point in VERTICES)
    vertices, triangles = read_ply((header + points + faces).encode())
    np.testing.assert_allclose(vertices, VERTICES, atol=1e-6)
    assert triangles.tolist() == [[0, 1, 2], [0, 1, 2], [0, 2, 3]]


ONE_LINE_STL = rearranged(text_stl(), 0, 10_000)


@pytest.mark.parametrize(
    ("data", "suffix", "why"),
    [
        (rearranged(ply(), 9, 6)[:-12], ".ply", "has 13 of 14 faces"),
        (rearranged(ply(), 9, 2)[:300], ".ply", "of 24 vertices: it is cut off"),
        (
            rearranged(ply() + b"3 0 1 2\n", 9, 6),
            ".ply",
            "has more numbers than its header announces (4 of",
        ),
        (ply() + b"3 0 1 2\n", ".ply", "has more lines than its header announces (1 of them)"),
        (rearranged(off(), 2, 6)[:-12], ".off", "has 13 of 14 faces"),
        (rearranged(off(), 2, 1)[:200], ".off", "of 24 vertices: it is cut off"),
        (
            rearranged(off() + b"3 0 1 2\n", 2, 6),
            ".off",
            "has more numbers than its header announces (4 of",
        ),
        (
            off() + b"3 0 1 2\n3 0 1 2\n",
            ".off",
            "has more lines than its header announces (2 of them)",
        ),
        (off().replace(b"4 0 1 ", b"9 0 1 "), ".off", "fewer corners on its line"),
        (ONE_LINE_STL[:-200], ".stl", "faces and no end: it is cut off"),
        (ONE_LINE_STL.replace(b"facet normal", b"plane normal", 1), ".stl", "132 vertices for 43"),
        (ONE_LINE_STL.replace(b"vertex 1", b"corner 1", 1), ".stl", "131 vertices for 44 faces"),
    ],
)
def test_what_such_a_text_lacks_or_has_too_much_is_said(data, suffix, why):
    assert why in refusal(data, suffix)


def test_a_facet_on_one_line_among_others_is_not_passed_over():
    lines = text_stl().split(b"\n")
    first = b" ".join([lines[0], *lines[1:8]])  # behind the name of the solid
    data = b"\n".join([first, *lines[8:]])
    assert len(parse_mesh(data, ".stl").faces) == len(TRIANGLES)


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (without_lines(ply(), 12), "has 2 of 14 faces"),
        (without_lines(ply(comment=COMMENTS), 3), "has 11 of 14 faces"),
        (without_lines(ply(), 14), "has 0 of 14 faces"),
        (without_lines(ply(), 20), "has 18 of 24 vertices"),
        (ply()[:-4], "has 13 of 14 faces"),
        (binary_ply("<")[:-20], "has 12 of 14 faces"),
        (binary_ply(">")[:-1], "has 13 of 14 faces"),
        (binary_ply(">", TRIANGLES)[:-40], "has 40 of 44 faces"),
        (binary_ply("<")[:300], "vertices: it is cut off"),
        (ply([*POLYGONS, [0, 1], [0, 1], [0, 1, 2]])[:-8], "has 16 of 17 faces"),
        (ply()[:100], "no whole header"),
        (ply().replace(b"property float z\n", b"property float w\n"), "vertices without z"),
        (ply().replace(b"vertex_indices", b"corners"), "faces without vertex_indices"),
        (ply().replace(b"float x", b"complex x"), "a header line that is not known"),
        (
            ply().replace(b"4 0 1", b"9 0 1"),
            "a face with fewer numbers on its line than it announces",
        ),
        (ply().replace(b"4 0 1", b"4 0 99"), "a vertex that does not exist"),
        (ply([]), "no faces"),
        (again(ply(), "face"), "has its faces in several elements, which are not read"),
        (again(ply(), "vertex"), "has its vertices in several elements, which are not read"),
        (again(ply(), "face", "polygon"), "has faces in elements that are not read: polygon"),
    ],
)
def test_a_ply_that_lacks_something_says_what(data, why):
    assert why in refusal(data, ".ply")


@pytest.mark.parametrize("head", ["OFF\n24 14 0\n", "OFF 24 14 0\n", "OFF24 14 0\n", "COFF24 14\n"])
def test_an_off_that_is_cut_off_says_how_much_there_is(head):
    assert "has 11 of 14 faces" in refusal(without_lines(off(head), 3), ".off")
    assert "has 13 of 14 faces" in refusal(off(head)[:-5], ".off")
    assert "has 22 of 24 vertices" in refusal(without_lines(off(head), 16), ".off")


def test_a_binary_off_that_is_cut_off_says_how_much_there_is():
    data, suffix = GOOD["binary off"]
    assert "has 13 of 14 faces" in refusal(data[:-4], suffix)
    assert "has 23 of 24 vertices" in refusal(data[: 11 + 12 + 24 * 12 - 1], suffix)


def test_an_off_of_other_dimensions_or_without_counts_says_so():
    assert "nOFF" in refusal(off("nOFF\n3\n24 14 0\n"), ".off")
    assert "no number of vertices and faces" in refusal(b"OFF\n", ".off")
    assert "vertex with fewer than 3 numbers on its line" in refusal(
        off().replace(b"0.866025 ", b"", 1), ".off"
    )
    assert "not a whole number" in refusal(off().replace(b"4 0 1 ", b"4 0 1.5 "), ".off")
    assert "does not begin with OFF" in refusal(b"24 14 0\n", ".off")


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (binary_stl()[:-500], "has 34 of 44 faces"),
        (binary_stl(b"solid exported")[:-1], "has 43 of 44 faces"),
        (binary_stl(count=0)[:-20], "has 43 faces and a part of one"),
        (text_stl()[:-200], "faces and no end"),
        (text_stl()[: -len(b"endsolid part\n")], "has 44 faces and no end"),
        (text_stl() + b"solid another\n", "has 44 faces and no end"),
        (text_stl(2).replace(b"facet normal", b"plane normal", 1), "132 vertices for 43 faces"),
        (binary_stl(count=40), "announces 40 faces and has room for 4 more"),
        (binary_stl() + binary_stl(), "several files in one"),
        (b"solid of nothing\nendsolid\n", "no faces"),
        (binary_stl(b"a part")[:60], "has only 60 bytes"),
    ],
)
def test_an_stl_that_lacks_something_says_what(data, why):
    assert why in refusal(data, ".stl")


@pytest.mark.parametrize("order", ["", "<", ">"])
def test_strips_of_a_ply_are_read_and_wound_as_its_faces(order):
    strip = [k for i in range(13) for k in (i % 12, i % 12 + 12)]
    rows = [[*strip, -1, *POLYGONS[0][:3]], POLYGONS[1][:3]]
    kind = {"": "ascii", "<": "binary_little_endian", ">": "binary_big_endian"}[order]
    header = ply_header(kind, faces=0).replace(
        "element face 0", "element range 1\nproperty list uchar float y\nelement tristrips 2"
    )
    if order:
        body = VERTICES.astype(order + "f4").tobytes() + struct.pack(f"{order}B2f", 2, 0.5, 1)
        body += b"".join(struct.pack(f"{order}B{len(r)}i", len(r), *r) for r in rows)
    else:
        body = (text_rows([]) + "2 0.5 1\n" + text_rows(rows)[len(text_rows([])) :]).encode()
    _, faces = read_ply(header.encode() + body)
    assert len(faces) == 24 + 2
    assert faces[[0, 1, -1]].tolist() == [[0, 12, 1], [1, 12, 13], [12, 13, 14]]


def test_elements_that_are_not_read_are_named_where_there_is_no_face():
    grid = ply([]).replace(b"element face 0", b"element range_grid 0")
    assert "range_grid" in refusal(grid, ".ply")


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n", "Git LFS pointer"),
        (b"<!DOCTYPE html><html><body>Sign in</body></html>", "web page"),
        (b"\xef\xbb\xbf\n <html>", "web page"),
        (b"<?xml version='1.0'?><Error><Code>AccessDenied</Code></Error>", "XML"),
        (b"\x1f\x8b\x08\0\0\0\0\0", "packed with gzip"),
        (b"PK\x03\x04rest", "zip archive"),
        (bytes(1000), "nothing but zeros"),
        (b"", "is empty: get it again"),
        (b"/annex/objects/MD5E-s1--2.obj\n", "git-annex pointer"),
        (b"../../.git/annex/objects/aa/bb/MD5E-s1--2.obj/MD5E-s1--2.obj\n", "git-annex pointer"),
    ],
)
@pytest.mark.parametrize("suffix", [".obj", ".ply", ".stl", ".off", ".glb"])
def test_what_is_no_mesh_at_all_is_called_what_it_is(data, why, suffix):
    assert why in refusal(data, suffix)


def test_a_mesh_under_the_name_of_another_kind_is_called_what_it_is():
    assert "is a PLY file under another name: call it *.ply" in refusal(ply(), ".obj")
    assert "is an OFF file under another name" in refusal(off("OFF\n24 14 0\n"), ".obj")
    assert "is an STL file under another name" in refusal(text_stl(), ".obj")
    assert "is an OBJ file under another name" in refusal(obj(), ".stl")
    assert "is a GLB file under another name" in refusal(MESH.export(file_type="glb"), ".stl")
    assert "none of the kinds" in refusal(ply(), ".dae")
