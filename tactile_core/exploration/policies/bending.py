"""Bending: a shape that was recalled is changed until it agrees with what was felt.

An object that nobody has met is none of those that are known, and those that are most like it still
contradict the touches here and there. So the outline of such a shape is moved to the touches, what
lies between them follows, and nothing of it stays where a ray has passed.
"""

import math

import numpy as np

from tactile_core.compiled import compiled

# How far from a touch its pull is felt, and how far it pulls at most, in shares of the image's
# side.
REACH, LONGEST_PULL = 6 / 64, 6 / 64
STIFFNESS = 0.2  # of what no touch pulls at, beside the pull of one that is right there


def bend(shapes: np.ndarray, felt: np.ndarray) -> np.ndarray:
    """Shapes (N, M, R, R) bool, bent to what was felt of each of N objects, (N, M, R, R) bool.

    felt : (N, R, R) int8, 1 at a touch, 0 where nothing is known, −1 where a ray has passed

    Every touch lies in all M shapes of its object then, and no pixel that was seen free does. Only
    the middle half of the image is looked at, where objects are.
    """
    side = felt.shape[-1]
    start, end = side // 4, side - side // 4
    windows = np.ascontiguousarray(shapes[:, :, start:end, start:end])  # (N, M, C, C)
    bent = shapes.copy()
    for some, own, window in zip(windows, felt[:, start:end, start:end], bent, strict=True):
        touches = np.argwhere(own > 0)  # (T, 2)
        _bend(some, touches, pulls(touches, len(own), side), LONGEST_PULL * side)
        window[:, start:end, start:end] = (some & (own >= 0)) | (own > 0)
    return bent


def pulls(touches: np.ndarray, side: int, resolution: int) -> np.ndarray:
    """How much each of T touches (T, 2) moves each pixel of a window, (T, C, C) in 0–1."""
    away = np.arange(side) - touches[:, :, None]  # (T, 2, C)
    near = np.exp(-((away / (REACH * resolution)) ** 2) / 2)
    pull = near[:, 0, :, None] * near[:, 1, None, :]  # (T, C, C)
    return pull / (pull.sum(axis=0) + STIFFNESS)


@compiled
def _bend(shapes: np.ndarray, touches: np.ndarray, pull: np.ndarray, farthest: float) -> None:
    """Move the outline of each of M shapes (M, C, C) to the touches (T, 2), in place."""
    side = shapes.shape[-1]
    outline = np.empty((side * side, 2), np.int64)
    moves = np.empty((len(touches), 2), np.float64)
    for shape in shapes:
        count = 0
        for row in range(side):
            for column in range(side):
                if shape[row, column] and _at_edge(shape, row, column):
                    outline[count] = row, column
                    count += 1
        if count == 0:
            continue
        for index, (row, column) in enumerate(touches):
            nearest = np.inf
            for near_row, near_column in outline[:count]:
                down, right = row - near_row, column - near_column
                distance = down * down + right * right
                if distance < nearest:
                    nearest = distance
                    moves[index] = down, right
            if nearest > farthest * farthest:
                moves[index] *= farthest / math.sqrt(nearest)
        whole = shape.copy()
        for row in range(side):
            for column in range(side):
                down = right = 0.5  # to the nearest pixel
                for index in range(len(touches)):
                    down -= pull[index, row, column] * moves[index, 0]
                    right -= pull[index, row, column] * moves[index, 1]
                there, along = math.floor(row + down), math.floor(column + right)
                inside = 0 <= there < side and 0 <= along < side
                shape[row, column] = inside and whole[there, along]


@compiled
def _at_edge(shape: np.ndarray, row: int, column: int) -> bool:
    """Whether one of a pixel's eight neighbours does not belong to the shape: see `outlines`."""
    last = len(shape) - 1
    if row == 0 or column == 0 or row == last or column == last:
        return True
    return not shape[row - 1 : row + 2, column - 1 : column + 2].all()
