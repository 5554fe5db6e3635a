"""Warped meshes: copies of a model that are a little like it, for nets to learn from.

What is learnt on one collection of mugs and bottles meets others, with proportions and bends that
it never saw. A copy that is stretched and bent at random widens what is learnt from, and it is the
geometry that is warped, not the pixels: it is rendered as sharply as the model itself.
"""

import numpy as np

STRETCH = 0.2  # standard deviation of the logarithm of the stretch along each of three axes
WAVES, BEND = 4, 0.04  # bends, and how far each moves a point, in bounding-box diagonals
LENGTHS = 0.5, 2.0  # of a wave, in periods for each bounding-box diagonal


def warp(vertices: np.ndarray, seed: int) -> np.ndarray:
    """Vertices (V, 3) stretched and bent at random, (V, 3) float64; 0 leaves them as they are.

    They are stretched along three axes of any direction, moved along a few slow waves, and then
    centred and scaled as every mesh is: to a bounding box around the origin whose diagonal is 1.
    """
    if seed == 0:
        return vertices
    rng = np.random.default_rng(seed)
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    warped = vertices @ axes * np.exp(rng.normal(0, STRETCH, 3)) @ axes.T
    for _ in range(WAVES):
        wave = direction(rng) * rng.uniform(*LENGTHS)
        phase = rng.uniform(0, 2 * np.pi)
        move = direction(rng) * rng.normal(0, BEND)
        warped = warped + np.sin(2 * np.pi * (warped @ wave) + phase)[:, None] * move
    low, high = warped.min(axis=0), warped.max(axis=0)
    return (warped - (low + high) / 2) / np.linalg.norm(high - low)


def direction(rng: np.random.Generator) -> np.ndarray:
    """A direction in space, (3,) of length 1, each as likely as any other."""
    vector = rng.normal(size=3)
    return vector / np.linalg.norm(vector)
