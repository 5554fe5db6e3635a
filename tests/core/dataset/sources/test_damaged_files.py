"""Damaged files of every kind: a mesh or a reason, and never more memory than a machine has."""

import contextlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_core.dataset.sources import parsing
from tactile_core.dataset.sources.archives import MAX_FILE
from tactile_core.dataset.sources.parsing import parse_mesh
from tactile_core.errors import TactileError
from tests.core.dataset.sources.mesh_bytes import (
    CORNERS,
    PLAIN,
    POINTS,
    POLYGONS,
    TRIANGLES,
    binary_ply,
    binary_stl,
    glb,
    gltf,
    obj,
    off,
    ply,
    text_rows,
    text_stl,
)

SCENE = [{"mesh": 0, "children": [1]}, {"mesh": 0, "translation": [0, 6, 0]}]
WHOLE = [
    (obj(), ".obj"),
    (obj(polygons=POLYGONS).replace(b" ", b"/1/1 ").decode().encode("utf-16"), ".obj"),
    (ply(), ".ply"),
    (ply(TRIANGLES), ".ply"),
    (binary_ply("<"), ".ply"),
    (binary_ply(">", TRIANGLES), ".ply"),
    (off(), ".off"),
    (off("OFF BINARY\n24 14 0\n"), ".off"),
    (binary_stl(), ".stl"),
    (text_stl(2), ".stl"),
    (glb(*gltf([POINTS, CORNERS], [PLAIN, PLAIN | {"mode": 5}], nodes=SCENE)), ".glb"),
]
EDITS = st.tuples(
    st.floats(0, 1),  # where
    st.integers(0, 12),  # how many bytes go
    st.one_of(
        st.binary(max_size=8),
        st.sampled_from(
            [b"\n", b" ", b"-1", b"\\\n", b"1e999", b"nan", b"4294967295", b"[", b"{}"]
        ),
    ),
)


@given(st.sampled_from(WHOLE), st.lists(EDITS, min_size=1, max_size=4), st.floats(0, 1.5))
@settings(max_examples=300)
def test_bytes_that_change_or_go_give_a_mesh_or_a_reason(whole, edits, keep):
    data, suffix = whole
    for where, gone, new in edits:
        at = int(where * len(data))
        data = data[:at] + new + data[at + gone :]
    with contextlib.suppress(TactileError):
        mesh = parse_mesh(data[: int(keep * len(data))], suffix)
        assert len(mesh.faces)
        assert np.isfinite(mesh.vertices).all()
        assert np.linalg.norm(mesh.extents) == pytest.approx(1)


@pytest.mark.parametrize("error", [MemoryError, RecursionError, OSError, KeyError("x\ny")])
@pytest.mark.parametrize("suffix", parsing.READERS)
def test_whatever_happens_to_a_reader_is_a_reason(monkeypatch, suffix, error):
    def broken(data):
        raise error

    monkeypatch.setitem(parsing.READERS, suffix, broken)
    with pytest.raises(TactileError, match=f"cannot be read as {suffix[1:].upper()}") as caught:
        parse_mesh(b"anything", suffix)
    assert "\n" not in str(caught.value)


def test_a_document_that_nests_without_end_is_a_reason():
    text = b"[" * 100_000
    body = len(text).to_bytes(4, "little") + b"JSON" + text
    data = b"glTF" + (2).to_bytes(4, "little") + (12 + len(body)).to_bytes(4, "little") + body
    with pytest.raises(TactileError, match="cannot be read as GLB"):
        parse_mesh(data, ".glb")


def test_a_file_above_the_limit_is_not_looked_at(monkeypatch):
    monkeypatch.setattr(parsing, "MAX_FILE", 3 << 20)
    with pytest.raises(TactileError, match="has 4 MiB, more than the 3 that are read"):
        parse_mesh(bytes(4 << 20), ".obj")


MEASURE = """
import sys
from pathlib import Path
from tactile_core.dataset.sources.parsing import parse_mesh
def peak():
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) * 1024 for line in lines if line.startswith("VmHWM"))
before = peak()
parse_mesh(Path(sys.argv[1]).read_bytes(), Path(sys.argv[1]).suffix)
print(peak() - before)
"""


def repeated(kind: str, times: int) -> bytes:
    """The body, or its faces, `times` over."""
    if kind == ".obj":
        return obj(polygons=TRIANGLES - 25) * times  # each counts back from its last vertex
    if kind == ".off":
        points = text_rows([])
        faces = text_rows(TRIANGLES).removeprefix(points)
        return f"OFF\n{24 * times} {44 * times} 0\n{points * times}{faces * times}".encode()
    whole = binary_ply("<", TRIANGLES).replace(b"face 44", b"face %d" % (44 * times))
    return whole + whole[-44 * 13 :] * (times - 1)


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="Linux tells the peak")
@pytest.mark.parametrize(("kind", "times"), [(".obj", 9000), (".off", 9000), (".ply", 20_000)])
def test_a_mesh_at_the_limit_fits_in_four_gigabytes(tmp_path, kind, times):
    path = tmp_path / f"large{kind}"
    path.write_bytes(repeated(kind, times))
    assert path.stat().st_size > 8 << 20
    peak = int(subprocess.check_output([sys.executable, "-c", MEASURE, str(path)]))
    assert peak / path.stat().st_size * MAX_FILE < 4 << 30
