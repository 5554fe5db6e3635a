"""Recall: known shapes that agree with what was felt, to try rays on.

A reconstruction says of every pixel how probable it is, but not what goes together: a handle is
here or there, never half in both places. So a few of the known shapes are drawn, by how well they
agree with the touches and the free space of an exploration, and bent to what still contradicts
them. Rays are tried on each as the oracle tries them on the true shape.
"""

import functools

import numpy as np

from tactile_core.exploration.policies.base import weights_version
from tactile_core.exploration.policies.bending import bend
from tactile_core.exploration.policies.scorer import RayScorer, best_rays_apart
from tactile_core.exploration.world.rays import cast_rays
from tactile_core.exploration.world.state import Explorations
from tactile_core.files import content_hash
from tactile_core.reconstruction.jaccard import jaccard_index
from tactile_core.reconstruction.known_shapes import KnownShapes, pack, unpack

TRIED = 16  # rays that `recall` tries: of every other candidate those of highest value
RECALLED = 12  # known shapes that it tries each of them on
# What is bent afterwards may disagree more than what the U-Net is shown: errors in pixels, as
# `known_shapes.SPREAD` and `FARTHEST` are.
SPREAD, FARTHEST = 1.0, 4.0
PIXELS_AT_A_TIME = 2**26  # explorations are dealt with in portions, to bound its memory


class RecallPolicy:
    """Tries rays of high value on known shapes, bent to what was felt, and casts the one
    that is best on average."""

    draws = False

    def __init__(self, name: str, seed: int, net: RayScorer, known: KnownShapes) -> None:
        self.name = name
        self.seed = seed
        self.net = net
        self.known = known

    @functools.cached_property
    def version(self) -> str:
        return content_hash(
            weights_version(self.net.state_dict()), pack(self.known.masks).tobytes()
        )

    def choose(
        self, explorations: Explorations, rng: np.random.Generator, deterministic: bool
    ) -> np.ndarray:
        portion = max(1, PIXELS_AT_A_TIME // (TRIED * RECALLED * explorations.resolution**2))
        chosen = []
        for start in range(0, len(explorations), portion):
            indices = np.arange(start, min(start + portion, len(explorations)))
            some = explorations.select(indices)
            rays = best_rays_apart(self.net, some, TRIED)
            felt = some.touches.astype(np.int8) - some.free.astype(np.int8)
            recalled = bend(self.known.draw(felt, RECALLED, rng), felt)
            expected = try_rays(some, rays, recalled).mean(axis=2)
            chosen.append(rays[np.arange(len(rays)), expected.argmax(axis=1)])
        return np.concatenate(chosen)


@functools.lru_cache(maxsize=1)
def load_known_shapes(packed: bytes, resolution: int) -> KnownShapes:
    """What `pack` packed, ready for recall; policies that know the same shapes share it."""
    rows = np.frombuffer(packed, np.uint8).reshape(-1, resolution**2 // 8)
    return KnownShapes(unpack(rows, resolution), spread=SPREAD, farthest=FARTHEST)


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
