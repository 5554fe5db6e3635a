import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_core.dataset.rendering.rasteriser import compiled, rasterise

RESOLUTION = 32
# Image coordinates in 1/256 pixel, so that snapping changes nothing; some lie outside the image.
steps = st.integers(-8 * 256, 40 * 256)
# Half pixels: corners and edges meet pixel centres all the time.
half_pixels = st.integers(-8, 72).map(lambda half: half * 128)


def triangles(coordinate):
    return st.lists(st.tuples(coordinate, coordinate), min_size=3, max_size=3)


def strictly_inside(corners, tolerance=0):
    """Brute force in exact integers: 1 inside, −1 outside, 0 where a centre lies on an edge."""
    (r0, c0), (r1, c1), (r2, c2) = corners
    row, column = np.mgrid[0:RESOLUTION, 0:RESOLUTION] * 256 + 128
    sides = np.array(
        [
            (c1 - c0) * (row - r0) - (r1 - r0) * (column - c0),
            (c2 - c1) * (row - r1) - (r2 - r1) * (column - c1),
            (c0 - c2) * (row - r2) - (r0 - r2) * (column - c2),
        ]
    )
    inside = (sides > tolerance).all(0) | (sides < -tolerance).all(0)
    outside = (sides > tolerance).any(0) & (sides < -tolerance).any(0)
    return inside.astype(int) - outside


def mask_of(corners, faces=((0, 1, 2),)):
    return rasterise(np.array(corners) / 256, np.array(faces), RESOLUTION)


@settings(deadline=None, max_examples=300)
@given(st.one_of(triangles(steps), triangles(half_pixels)))
def test_a_pixel_is_covered_when_its_centre_lies_inside(corners):
    expected = strictly_inside(corners)
    mask = mask_of(corners)
    assert mask[expected > 0].all()
    assert not mask[expected < 0].any()


@settings(deadline=None)
@given(triangles(st.floats(-8, 40)))
def test_snapping_moves_an_edge_by_no_more_than_a_step(corners):
    scaled = [(row * 256, column * 256) for row, column in corners]
    longest = max(np.hypot(*np.subtract(a, b)) for a in scaled for b in scaled)
    expected = strictly_inside(scaled, tolerance=longest + 1)
    mask = rasterise(np.array(corners), np.array([[0, 1, 2]]), RESOLUTION)
    assert mask[expected > 0].all()
    assert not mask[expected < 0].any()


@settings(deadline=None, max_examples=300)
@given(st.one_of(triangles(steps), triangles(half_pixels)))
def test_the_order_of_the_corners_does_not_matter(corners):
    mask = mask_of(corners)
    for faces in ([[2, 1, 0]], [[1, 2, 0]], [[0, 2, 1]], [[0, 1, 2], [2, 1, 0]]):
        assert (mask_of(corners, faces) == mask).all()


@settings(deadline=None, max_examples=300)
@given(st.integers(0, 48), st.integers(0, 48), st.integers(1, 16), st.integers(1, 16))
def test_triangles_that_share_edges_cover_every_pixel_centre_once(top, left, height, width):
    """A rectangle with corners on half pixels, cut in four around a point within it."""
    corners = [(top, left), (top, left + width), (top + height, left + width), (top + height, left)]
    middle = (top + height // 2, left + width // 3)
    points = np.array([*corners, middle]) / 2
    faces = [(0, 1, 4), (1, 2, 4), (4, 2, 3), (3, 0, 4)]
    counts = sum(rasterise(points, np.array([face]), RESOLUTION).astype(int) for face in faces)
    assert counts.max(initial=0) <= 1
    assert (rasterise(points, np.array(faces), RESOLUTION) == (counts == 1)).all()
    if top + height <= 2 * RESOLUTION and left + width <= 2 * RESOLUTION:
        # Half-open sides: as many centres as whole pixels, give or take the half ones.
        assert counts.sum() in {
            rows * columns
            for rows in {height // 2, (height + 1) // 2}
            for columns in {width // 2, (width + 1) // 2}
        }


def test_a_rectangle_on_the_pixel_grid_covers_exactly_its_pixels():
    points = np.array([(3, 5), (3, 20), (11, 20), (11, 5)], dtype=float)
    mask = rasterise(points, np.array([(0, 1, 2), (0, 3, 2)]), RESOLUTION)
    expected = np.zeros((RESOLUTION, RESOLUTION), dtype=bool)
    expected[3:11, 5:20] = True
    assert (mask == expected).all()


def test_centres_on_an_edge_go_with_the_left_and_the_bottom_edge():
    """As Mesa's OpenGL draws them; tests of `opengl` compare the two renderers."""
    points = np.array([(2.5, 2.5), (2.5, 6.5), (5.5, 6.5), (5.5, 2.5)])
    mask = rasterise(points, np.array([(0, 1, 2), (0, 2, 3)]), RESOLUTION)
    expected = np.zeros((RESOLUTION, RESOLUTION), dtype=bool)
    expected[3:6, 2:6] = True
    assert (mask == expected).all()


def test_triangles_without_area_and_meshes_without_faces_cover_nothing():
    points = np.array([(1, 1), (20, 20), (10.5, 10.5), (10.5, 10.5)])
    degenerate = np.array([(0, 1, 2), (2, 3, 2), (0, 0, 0), (0, 1, 0)])
    assert not rasterise(points, degenerate, RESOLUTION).any()
    assert not rasterise(points, np.empty((0, 3), dtype=int), RESOLUTION).any()


def test_points_far_outside_the_image_do_no_harm():
    points = np.array([(-1e6, -1e6), (-1e6, 1e6), (1e6, 0)])
    assert rasterise(points, np.array([(0, 1, 2)]), RESOLUTION).all()
    assert not rasterise(points + 1e7, np.array([(0, 1, 2)]), RESOLUTION).any()


def test_a_function_compiles_where_the_cache_cannot_be_written():
    """Code without a source file has no place for a cache, like code in a read-only tree."""
    namespace: dict = {}
    exec("def double(x):\n    return 2 * x", namespace)
    assert compiled(namespace["double"])(21) == 42
