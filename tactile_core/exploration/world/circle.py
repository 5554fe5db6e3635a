"""The circle that rays start and end on (report, section VI.A)."""

import functools

import numpy as np
from skimage.draw import circle_perimeter


def middle(resolution: int) -> int:
    """Row and column of the circle's centre: the middle pixel closest to (0, 0)."""
    return resolution // 2 - 1


@functools.cache
def circle_pixels(resolution: int) -> np.ndarray:
    """The P distinct pixels of the circle of radius R/2−1, (P, 2) int16 as (row, column).

    In angular order, so that neighbouring indices are neighbours on the circle: from the
    pixel below the centre (the largest row) towards larger columns.
    """
    pixels = report_circle(resolution)
    rows, columns = (pixels - middle(resolution)).T
    order = np.argsort(np.arctan2(columns, rows) % (2 * np.pi), kind="stable")
    return frozen(pixels[order])


@functools.cache
def report_circle(resolution: int) -> np.ndarray:
    """The same pixels in the report's order: as scikit-image draws them, octant by octant.

    There neighbouring indices lie on opposite sides of the circle. 720 pixels at R = 256.
    """
    centre = middle(resolution)
    rows, columns = circle_perimeter(centre, centre, centre)
    distinct = dict.fromkeys(zip(rows.tolist(), columns.tolist(), strict=True))
    return frozen(np.array(list(distinct), dtype=np.int16))


@functools.cache
def report_order(resolution: int) -> np.ndarray:
    """Index into `circle_pixels` of each pixel of `report_circle`, (P,) int."""
    position = {tuple(pixel): index for index, pixel in enumerate(circle_pixels(resolution))}
    return frozen(np.array([position[tuple(pixel)] for pixel in report_circle(resolution)]))


def angle_index(angles: np.ndarray, resolution: int) -> np.ndarray:
    """Index of the circle pixel nearest in direction to each angle (radians, any shape)."""
    pixels = len(circle_pixels(resolution))
    rows, columns = (circle_pixels(resolution) - middle(resolution)).T.astype(float)
    directions = np.arctan2(columns, rows) % (2 * np.pi)
    after = np.searchsorted(directions, angles % (2 * np.pi))
    before, after = (after - 1) % pixels, after % pixels
    nearer = np.abs(turn(directions[before] - angles)) <= np.abs(turn(directions[after] - angles))
    return np.where(nearer, before, after)


def turn(angles: np.ndarray) -> np.ndarray:
    """Angles (radians) brought into [−π, π)."""
    return (angles + np.pi) % (2 * np.pi) - np.pi


def frozen(array: np.ndarray) -> np.ndarray:
    """The array, read-only: it is cached and shared."""
    array.setflags(write=False)
    return array
