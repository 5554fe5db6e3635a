"""What rays feel, for training the U-Net on what it will meet.

Rays touch what they see from outside first, so their touches lie otherwise than a uniform draw
from the outline. Half of each batch stays uniform, as in the report (section V).
"""

import numpy as np

from tactile_core.dataset.shapes import Shapes
from tactile_core.exploration.rays import candidate_rays, cast_rays, mark_free
from tactile_core.exploration.references import GOLDEN, towards_middle
from tactile_core.reconstruction.batches import DrawFelt, outline_touches, touch_images

RAYS = 10
SEQUENCES = 8  # of each kind for each shape
RAY_SHARE = 0.5


def rays_and_outlines(shapes: Shapes, seed: int, free_space: bool) -> DrawFelt:
    """Draws half of the images from touches of the outline, half as rays would make them.

    The latter are the touches of the first 1–10 rays of a sweep through the middle from any
    angle, of candidate rays at random, or of a mixture of both; rays that miss leave fewer
    touches. With `free_space` the images also show where these rays passed.
    """
    uniform = outline_touches(shapes)
    rays, touches = ray_sequences(shapes, np.random.default_rng(seed))

    def draw(rng: np.random.Generator, indices: np.ndarray) -> np.ndarray:
        points, held = uniform(rng, indices)
        which = indices, rng.integers(rays.shape[1], size=len(indices))
        cast = np.arange(RAYS) < rng.integers(1, RAYS + 1, (len(indices), 1))
        by_rays = rng.random(len(indices)) < RAY_SHARE
        made = touches[which]
        points = np.where(by_rays[:, None, None], made, points)
        held = np.where(by_rays[:, None], cast & (made[..., 0] >= 0), held)
        images = touch_images(points, held, shapes.resolution)
        if free_space:
            images -= free_images(rays[which], made, cast & by_rays[:, None], shapes.resolution)
        return images

    return draw


def free_images(
    rays: np.ndarray, touches: np.ndarray, cast: np.ndarray, resolution: int
) -> np.ndarray:
    """Where rays (B, K, 2) passed before their touches (B, K, 2), (B, R, R) int8, 0 or 1.

    cast : (B, K) bool, which of the rays count
    """
    free = np.zeros((len(rays), resolution, resolution), np.uint8)
    for ray in range(rays.shape[1]):
        which = np.flatnonzero(cast[:, ray])
        some = free[which]
        mark_free(some, rays[which, ray], touches[which, ray])
        free[which] = some
    return free.astype(np.int8)


def ray_sequences(shapes: Shapes, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Ten rays in a row, many times for each of N shapes: rays (N, 3 · SEQUENCES, RAYS, 2) int
    and touches, int16 of the same shape, (−1, −1) for a miss."""
    count = len(shapes) * SEQUENCES * RAYS
    candidates = candidate_rays(shapes.resolution).reshape(-1, 2)
    at_random = candidates[rng.integers(len(candidates), size=count)]
    start = rng.uniform(0, 2 * np.pi, (len(shapes), SEQUENCES, 1))
    angles = start + 2 * np.pi * GOLDEN * np.arange(RAYS)
    sweeps = towards_middle(angles.ravel(), shapes.resolution)
    mixed = np.where(rng.random((count, 1)) < 0.5, at_random, sweeps)
    owners = np.repeat(np.arange(len(shapes)), SEQUENCES * RAYS)
    shape = len(shapes), SEQUENCES, RAYS, 2
    kinds = at_random, sweeps, mixed
    touches = [cast_rays(shapes.masks, rays, owners).reshape(shape) for rays in kinds]
    return (
        np.concatenate([rays.reshape(shape) for rays in kinds], axis=1),
        np.concatenate(touches, axis=1),
    )
