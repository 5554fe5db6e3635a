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


def view(vertices: np.ndarray, rotation: float) -> np.ndarray:
    """(V, 3) model coordinates as (V, 3) float32 camera coordinates: right, up, towards the viewer.

    `rotation` turns the geometry about the viewing axis, in degrees, counter-clockwise as seen
    in the image; 0 leaves it as it is. Float32 because OpenGL takes nothing finer, and both
    renderers start from the same numbers.
    """
    x, y, z = np.asarray(vertices, dtype=np.float64).T
    right, up, back = y, (z - x) * math.sqrt(0.5), (z + x) * math.sqrt(0.5)
    cosine, sine = math.cos(math.radians(rotation)), math.sin(math.radians(rotation))
    turned = (cosine * right - sine * up, sine * right + cosine * up, back)
    return np.stack(turned, axis=1).astype(np.float32)


def project(vertices: np.ndarray, rotation: float, resolution: int) -> np.ndarray:
    """(V, 3) model coordinates as (V, 2) float64 (row, column) image coordinates.

    Window coordinates are rounded to float32, with up positive, as OpenGL's viewport
    transform does, so that the rasteriser sees the very points that OpenGL sees.
    """
    right_up = view(vertices, rotation)[:, :2].astype(np.float64)
    window = (right_up * (resolution / 2) + resolution / 2).astype(np.float32).astype(np.float64)
    return np.stack([resolution - window[:, 1], window[:, 0]], axis=1)
