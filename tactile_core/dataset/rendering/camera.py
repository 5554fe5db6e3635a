"""The report's camera (section IV): where each vertex of a mesh lands in the image.

An orthographic camera looks horizontally at the model from 45° azimuth, between the model's
+X and +Z. The model's +Y points to the image's right, so a bottle lies on its side, and what
lies towards +Z and −X points up. The image spans [−1, 1] in both directions: a model whose
bounding-box diagonal is 1 stays within R/4 pixels of the middle.

Image coordinates are (row, column) with row 0 on top. Pixel (r, c) covers [r, r+1) × [c, c+1);
its centre is (r + 0.5, c + 0.5), and the middle of the image is (R/2, R/2).
"""

import math

import numpy as np

STEPS = 256  # positions per pixel that a vertex may take, as in Mesa and current GPUs


def project(vertices: np.ndarray, rotation: float, resolution: int) -> np.ndarray:
    """(V, 3) model coordinates as (V, 2) float64 (row, column) image coordinates.

    `rotation` turns the geometry about the viewing axis, in degrees, counter-clockwise as seen
    in the image; 0 leaves it as it is. Coordinates are snapped to 1/256 pixel. OpenGL would do
    so itself, but may judge a sliver's winding before it snaps and its area afterwards; snapped
    here, once, slivers too are the same for every renderer.
    """
    x, y, z = np.asarray(vertices, dtype=np.float64).T
    right, up = y, (z - x) * math.sqrt(0.5)
    cosine, sine = math.cos(math.radians(rotation)), math.sin(math.radians(rotation))
    right, up = cosine * right - sine * up, sine * right + cosine * up
    middle = resolution / 2
    points = np.stack([middle - middle * up, middle + middle * right], axis=1)
    return np.rint(points * STEPS) / STEPS
