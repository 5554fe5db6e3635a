"""Recall: known shapes that agree with what was felt, to try rays on.

A reconstruction says of every pixel how probable it is, but not what goes together: a handle is
here or there, never half in both places. So a few of the known shapes are drawn, by how well they
agree with the touches and the free space of an exploration, and bent to what still contradicts
them. Rays are tried on each as the oracle tries them on the true shape.
"""

import functools
import itertools

import numpy as np
import torch

from tactile_core.exploration.policies.base import weights_version
from tactile_core.exploration.policies.bending import bend
from tactile_core.exploration.policies.scorer import RayScorer, best_rays_apart
from tactile_core.exploration.world.rays import cast_rays
from tactile_core.exploration.world.state import Explorations
from tactile_core.files import content_hash
from tactile_core.reconstruction.jaccard import THRESHOLD
from tactile_core.reconstruction.known_shapes import KnownShapes, pack, unpack

# How many rays, of every other candidate those of highest value, are tried on how many known
# shapes: for the first ray of an exploration, the second, the third, and each further one. As long
# as little was felt very different shapes agree with it, and a few say little of the best ray.
TRIED_ON = ((32, 1024), (32, 256), (16, 64), (16, 48))
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
        first, same = distinct(explorations)
        chosen = np.empty((len(first), 2), int)
        numbers = np.minimum(explorations.rays[first], len(TRIED_ON) - 1)
        for number in np.unique(numbers):
            tried, recalled = TRIED_ON[number]
            places = np.flatnonzero(numbers == number)
            portion = max(1, PIXELS_AT_A_TIME // (tried * recalled * explorations.resolution**2))
            for start in range(0, len(places), portion):
                some = places[start : start + portion]
                alike = explorations.select(first[some])
                chosen[some] = self.best_tried(alike, tried, recalled, rng)
        return chosen[same]

    def best_tried(
        self, explorations: Explorations, tried: int, recalled: int, rng: np.random.Generator
    ) -> np.ndarray:
        """The best of `tried` rays on average over `recalled` shapes, (N, 2) int."""
        rays = best_rays_apart(self.net, explorations, tried)
        felt = all_felt(explorations)
        shapes = bend(self.known.draw(felt, recalled, rng), felt)
        expected = try_rays(explorations, rays, shapes).mean(axis=2)
        return rays[np.arange(len(rays)), expected.argmax(axis=1)]


def all_felt(explorations: Explorations) -> np.ndarray:
    """1 at a touch, −1 where a ray has passed, (N, R, R) int8, also where the U-Net sees no more
    than touches."""
    return explorations.touches.astype(np.int8) - explorations.free.astype(np.int8)


def distinct(explorations: Explorations) -> tuple[np.ndarray, np.ndarray]:
    """Of N explorations the first of each number of rays and all that was felt, (n,) int, and to
    which of those each of the N is equal, (N,) int."""
    seen: dict[tuple[int, bytes], int] = {}
    states = zip(explorations.rays, all_felt(explorations), strict=True)
    same = np.array(
        [seen.setdefault((int(n), felt.tobytes()), len(seen)) for n, felt in states], int
    )
    return np.unique(same, return_index=True)[1], same


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
    # Each exploration's predictions beside its shapes: few of the first serve many of the second.
    begins = np.searchsorted(owners[first], np.arange(len(rays) + 1))
    asked = same.reshape(*rays.shape[:2], each) - begins[:-1, None, None]
    scores = np.empty(asked.shape, np.float32)
    for owner, (begin, end) in enumerate(itertools.pairwise(begins)):
        table = jaccard_of_each(predictions[begin:end], shapes[owner])
        scores[owner] = table[asked[owner], np.arange(each)]
    return scores


def jaccard_of_each(predictions: np.ndarray, masks: np.ndarray) -> np.ndarray:
    """`jaccard_index` of each of U predictions (U, R, R) with each of M masks (M, R, R), (U, M)."""
    predicted = torch.from_numpy(predictions > THRESHOLD).flatten(1).float()
    inside = torch.from_numpy(masks).flatten(1).float()
    overlap = (predicted @ inside.T).numpy().astype(int)  # of pixels: whole numbers, so exact
    union = np.add.outer(predicted.sum(dim=1).numpy(), inside.sum(dim=1).numpy()) - overlap
    return np.where(union == 0, 100.0, 100.0 * overlap / np.maximum(union, 1)).astype(np.float32)
