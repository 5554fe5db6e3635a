"""Rays: pixel lines between two pixels of the circle, and the touch where one meets a mask.

A ray is a pair of indices (alpha, beta) into `circle_pixels`. It starts at alpha; its touch
is the first mask pixel on the line (report, section VI.A, step 1).
"""

import functools

import numba
import numpy as np
from skimage.draw import line

from tactile_core.compiled import compiled
from tactile_core.exploration.world.circle import angle_index, circle_pixels, frozen

RAYS = 10  # in an episode (report, section VI)
RAY_LIMIT = 100  # of an episode that goes on until ten touches are held
MISS = -1

# steps, row, column, error, row step, column step, long, short, steep
Walk = tuple[int, int, int, int, int, int, int, int, bool]


def cast_rays(
    masks: np.ndarray, rays: np.ndarray, shape_of_ray: np.ndarray | None = None
) -> np.ndarray:
    """First mask pixel of each ray, (N, 2) int16 as (row, column); (−1, −1) for a miss.

    masks : (M, R, R) bool
    rays : (N, 2) int, (alpha, beta)
    shape_of_ray : (N,) int, the mask each ray meets; by default ray i meets mask i
    """
    which = np.arange(len(rays)) if shape_of_ray is None else np.asarray(shape_of_ray)
    ends = ray_ends(rays, masks.shape[-1])
    touches = np.empty((len(rays), 2), np.int16)
    _first_hits(np.ascontiguousarray(masks), which, ends, touches)
    return touches


def ray_ends(rays: np.ndarray, resolution: int) -> np.ndarray:
    """The rays' end pixels, (N, 4) int16: row and column of alpha, then of beta."""
    return circle_pixels(resolution)[np.asarray(rays)].reshape(-1, 4)


def mark_free(free: np.ndarray, rays: np.ndarray, touches: np.ndarray) -> np.ndarray:
    """Set to 1, in place, the pixels that each ray crossed before its touch (all for a miss).

    free : (N, R, R) uint8; rays : (N, 2) int; touches : (N, 2) int16 as from `cast_rays`

    Returns how many pixels were not known to be free before, (N,) int.
    """
    found = np.zeros(len(rays), int)
    _mark_free(free, ray_ends(rays, free.shape[-1]), touches, found)
    return found


@functools.cache
def candidate_rays(resolution: int, angles: int = 36, offsets: int = 11) -> np.ndarray:
    """A grid of rays, (angles, offsets, 2) int: parallel bundles from every direction.

    Angle k points from 2πk/angles; the offsets lie evenly across the middle half of the
    image, the only part that a shape can reach.
    """
    radius = resolution / 2 - 1
    reach = resolution / 4 - 1
    theta = 2 * np.pi * np.arange(angles)[:, None] / angles
    lean = np.arcsin(np.linspace(-reach, reach, offsets) / radius)
    alpha = angle_index(theta + lean, resolution)
    beta = angle_index(theta + np.pi - lean, resolution)
    return frozen(np.stack([alpha, beta], axis=-1))


@functools.cache
def pixels_along(resolution: int) -> np.ndarray:
    """Flat pixel indices along each of `candidate_rays`, (rays, R) int, −1 beyond its end."""
    rays = candidate_rays(resolution).reshape(-1, 2)
    along = np.full((len(rays), resolution), -1)
    for pixels, ends in zip(along, ray_ends(rays, resolution), strict=True):
        rows, columns = line(*map(int, ends))
        pixels[: len(rows)] = rows * resolution + columns
    return frozen(along)


@compiled
def _first_hits(
    masks: np.ndarray, which: np.ndarray, ends: np.ndarray, touches: np.ndarray
) -> None:
    for ray in range(len(ends)):
        mask = masks[which[ray]]
        row, column, last_row, last_column = ends[ray]
        walk = _begin(row, column, last_row, last_column)
        touches[ray, 0] = touches[ray, 1] = MISS
        for _ in range(walk[0] + 1):
            if mask[walk[1], walk[2]]:
                touches[ray, 0], touches[ray, 1] = walk[1], walk[2]
                break
            walk = _advance(walk)


@compiled
def _mark_free(free: np.ndarray, ends: np.ndarray, touches: np.ndarray, found: np.ndarray) -> None:
    for ray in range(len(ends)):
        row, column, last_row, last_column = ends[ray]
        walk = _begin(row, column, last_row, last_column)
        for _ in range(walk[0] + 1):
            if walk[1] == touches[ray, 0] and walk[2] == touches[ray, 1]:
                break
            found[ray] += 1 - free[ray, walk[1], walk[2]]
            free[ray, walk[1], walk[2]] = 1
            walk = _advance(walk)


@numba.njit(inline="always")
def _begin(row: int, column: int, last_row: int, last_column: int) -> Walk:
    """Bresenham's line, pixel for pixel that of `skimage.draw.line`."""
    rows, columns = abs(last_row - row), abs(last_column - column)
    row_step = 1 if last_row > row else -1
    column_step = 1 if last_column > column else -1
    steep = rows > columns
    long, short = (rows, columns) if steep else (columns, rows)
    return long, row, column, 2 * short - long, row_step, column_step, long, short, steep


@numba.njit(inline="always")
def _advance(walk: Walk) -> Walk:
    steps, row, column, error, row_step, column_step, long, short, steep = walk
    if error >= 0 and long > 0:
        if steep:
            column += column_step
        else:
            row += row_step
        error -= 2 * long
    if steep:
        row += row_step
    else:
        column += column_step
    error += 2 * short
    return steps, row, column, error, row_step, column_step, long, short, steep
