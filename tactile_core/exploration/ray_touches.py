"""Touches that rays make, for training the U-Net on what it will meet.

Rays touch what they see from outside first, so their touches lie otherwise than a uniform draw
from the outline. Half of each batch stays uniform, as in the report (section V).
"""

import numpy as np

from tactile_core.dataset.shapes import Shapes
from tactile_core.exploration.rays import candidate_rays, cast_rays
from tactile_core.exploration.references import GOLDEN, towards_middle
from tactile_core.reconstruction.batches import DrawTouches, outline_touches

RAYS = 10
SEQUENCES = 8  # of each kind for each shape


def rays_and_outlines(shapes: Shapes, seed: int) -> DrawTouches:
    """Draws half of the touch sets from the outline, half as rays would make them.

    The latter are the touches of the first 1–10 rays of a sweep through the middle from any
    angle, or of candidate rays at random; rays that miss leave fewer touches.
    """
    uniform = outline_touches(shapes)
    sequences = touch_sequences(shapes, np.random.default_rng(seed))

    def draw(rng: np.random.Generator, indices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        points, held = uniform(rng, indices)
        made = sequences[indices, rng.integers(sequences.shape[1], size=len(indices))]
        cast = np.arange(RAYS) < rng.integers(1, RAYS + 1, (len(indices), 1))
        by_rays = rng.random(len(indices)) < 0.5
        points = np.where(by_rays[:, None, None], made, points)
        held = np.where(by_rays[:, None], cast & (made[..., 0] >= 0), held)
        return points, held

    return draw


def touch_sequences(shapes: Shapes, rng: np.random.Generator) -> np.ndarray:
    """Touches of ten rays in a row, (N, 2 · SEQUENCES, RAYS, 2) int16, (−1, −1) for a miss."""
    count = len(shapes) * SEQUENCES * RAYS
    candidates = candidate_rays(shapes.resolution).reshape(-1, 2)
    at_random = candidates[rng.integers(len(candidates), size=count)]
    start = rng.uniform(0, 2 * np.pi, (len(shapes), SEQUENCES, 1))
    angles = start + 2 * np.pi * GOLDEN * np.arange(RAYS)
    sweeps = towards_middle(angles.ravel(), shapes.resolution)
    owners = np.repeat(np.arange(len(shapes)), SEQUENCES * RAYS)
    shape = len(shapes), SEQUENCES, RAYS, 2
    made = [cast_rays(shapes.masks, rays, owners).reshape(shape) for rays in (at_random, sweeps)]
    return np.concatenate(made, axis=1)
