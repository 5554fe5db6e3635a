"""What can draw no pixel decides neither size nor place of a mesh."""

import numpy as np
import pytest

from tactile_core.dataset.sources.parsing import parse_mesh
from tests.core.dataset.sources.mesh_bytes import TRIANGLES, mask, obj

GOOD = obj()


@pytest.mark.parametrize("away", [2, 10, 30, 500, 1e9])
@pytest.mark.parametrize(
    "stray",
    [
        b"v {0} {0} {0}\n",  # used by no face
        b"v {0} {0} {0}\nf -1 -1 -1\n",
        b"v {0} {0} {0}\nf 1 -1 -1\n",
        b"v {0} {0} {0}\nv {0} {0} -{0}\nv {0} {0} 0\nf -1 -2 -3\n",  # three on a line
        b"v -{0} 0 {0}\nv {0} {0} {0}\nf 1 1 -1\nf 1 -2 1\n",
    ],
)
def test_strays_without_area_leave_the_mesh_as_it_was(stray, away):
    data = GOOD + stray.decode().format(away).encode()
    mesh, plain = parse_mesh(data, ".obj"), parse_mesh(GOOD, ".obj")
    assert mesh.faces.tolist() == plain.faces.tolist()
    np.testing.assert_array_equal(mesh.vertices, plain.vertices)


@pytest.mark.parametrize("away", [10, 30, 500])
@pytest.mark.parametrize("size", [1e-6, 1e-3, 1e-2])
def test_a_speck_far_away_leaves_the_mesh_as_it_was(away, size):
    speck = (
        f"v {away} {away} {away}\nv {away + size} {away} {away}\nv {away} {away + size} {away}\n"
    )
    data = GOOD + speck.encode() + b"f -1 -2 -3\n"
    np.testing.assert_array_equal(mask(data, ".obj"), mask(GOOD, ".obj"))


def test_a_part_that_can_be_seen_counts_however_far_it_is():
    data = GOOD + b"v 10 10 10\nv 11 10 10\nv 10 11 10\nf -1 -2 -3\n"
    mesh = parse_mesh(data, ".obj")
    assert len(mesh.faces) == len(TRIANGLES) + 1
    assert mask(data, ".obj").sum() < mask(GOOD, ".obj").sum() / 4


def test_faces_without_area_within_the_body_stay():
    assert len(parse_mesh(GOOD + b"f 1 1 2\nf 1 2 2\n", ".obj").faces) == len(TRIANGLES) + 2


@pytest.mark.parametrize("scale", [1e-150, 1e-6, 1.0, 1e6, 1e150])
def test_what_can_be_seen_does_not_hang_on_the_unit(scale):
    points = "".join(f"v {x!r} {y!r} 0\n" for x, y in (np.eye(3, 2) * scale).tolist())
    stray = f"v {7 * scale!r} 0 0\nf 1 4 4\n"
    mesh = parse_mesh(f"{points}f 1 2 3\n{stray}".encode(), ".obj")
    assert mesh.faces.tolist() == [[0, 1, 2]]


def test_a_body_of_many_small_faces_is_no_speck():
    """Each of the faces is smaller than a speck, and so are the outermost ones together."""
    steps = np.linspace(0, 1, 400)
    points = "".join(f"v {x:.6f} {y:.6f} 0\n" for x in steps for y in (0, 0.001))
    faces = "".join(f"f {2 * k + 1} {2 * k + 2} {2 * k + 3}\n" for k in range(399))
    assert len(parse_mesh((points + faces).encode(), ".obj").faces) == 399
