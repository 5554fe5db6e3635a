"""Recall: known shapes that agree with what was felt, to try rays on.

A reconstruction says of every pixel how probable it is, but not what goes together: a handle is
here or there, never half in both places. So a few of the known shapes are drawn, by how well they
agree with the touches and the free space of an exploration, and rays are tried on each of them as
the oracle tries them on the true shape.
"""

import functools

import numpy as np

from tactile_core.exploration.rays import cast_rays
from tactile_core.exploration.state import Explorations
from tactile_core.reconstruction.jaccard import jaccard_index
from tactile_core.reconstruction.known_shapes import KnownShapes, unpack


@functools.lru_cache(maxsize=1)
def known_shapes(packed: bytes, resolution: int) -> KnownShapes:
    """What `pack` packed, ready for recall; policies that know the same shapes share it."""
    rows = np.frombuffer(packed, np.uint8).reshape(-1, resolution**2 // 8)
    return KnownShapes(unpack(rows, resolution))


def try_rays(explorations: Explorations, rays: np.ndarray, shapes: np.ndarray) -> np.ndarray:
    """Jaccard index (N, K, M) of each exploration had it cast each of K rays at each of M shapes.

    rays : (N, K, 2) int; shapes : (N, M, R, R) bool, what each exploration might be of

    What several of these touches would look like to the U-Net it is asked about once.
    """
    resolution, each = explorations.resolution, shapes.shape[1]
    owners, which_ray, which_shape = (
        index.ravel() for index in np.indices((*rays.shape[:2], each))
    )
    cast, whole = rays[owners, which_ray], shapes.reshape(-1, resolution, resolution)
    what = owners * each + which_shape
    hits = cast_rays(whole, cast, what)
    places = np.where(hits[:, 0] < 0, -1, hits[:, 0].astype(int) * resolution + hits[:, 1])
    # Where the U-Net sees touches only, it is all the same to it which ray led there.
    ways = which_ray if explorations.reconstructor.free_space else np.zeros_like(which_ray)
    ends = np.stack([owners, ways, places])
    _, first, same = np.unique(ends, axis=1, return_index=True, return_inverse=True)
    felt = explorations.felt_after(owners[first], cast[first], hits[first])
    predictions = explorations.reconstructor.predict(felt)
    scores = jaccard_index(predictions[same], whole[what])
    return scores.reshape(*rays.shape[:2], each)
