"""Recall: known shapes that agree with what was felt, to try rays on.

A reconstruction says of every pixel how probable it is, but not what goes together: a handle is
here or there, never half in both places. Shapes that are remembered whole keep that. So the train
shapes, in all eight orientations, are weighed by how well they agree with the touches and the
free space of an exploration, a few are drawn, and rays are tried on each of them as the oracle
tries them on the true shape.
"""

import functools
from collections.abc import Callable

import numpy as np
import torch
from scipy import ndimage
from torch import Tensor

from tactile_core.exploration.rays import cast_rays
from tactile_core.exploration.state import Explorations
from tactile_core.reconstruction.batches import ORIENTATIONS, orient
from tactile_core.reconstruction.jaccard import jaccard_index

MOST = 4096  # shapes remembered; at resolution 64 each takes 64 KiB
COARSEST = 64  # resolution at which shapes and what was felt are compared
# A touch speaks against a shape by its squared distance to that shape's outline, as under a normal
# error of so many pixels; beyond the farthest, one stray touch should not rule a shape out.
SPREAD, FARTHEST = 0.7, 3.0
FREE_PIXEL = 1.0  # and every pixel inside the shape that was seen free, by so much


def pack(masks: np.ndarray) -> np.ndarray:
    """At most `MOST` of the masks (N, R, R) bool, evenly picked, as (n, R²/8) uint8."""
    picked = masks[:: -(-len(masks) // MOST)]
    return np.packbits(picked.reshape(len(picked), -1), axis=1)


@functools.lru_cache(maxsize=1)
def known_shapes(packed: bytes, resolution: int) -> "KnownShapes":
    """What `pack` packed, ready for recall; policies that know the same shapes share it."""
    bits = np.unpackbits(np.frombuffer(packed, np.uint8))
    return KnownShapes(bits.reshape(-1, resolution, resolution).astype(bool))


class KnownShapes:
    """Shapes to recall, each in eight orientations.

    masks : (n, R, R) bool, in the first orientation
    evidence : (2·C², 8n) float32; what a touch (first half) and a free pixel (second half) at
        each of C·C places in the middle half of the image add to each shape's log-likelihood
    """

    def __init__(self, masks: np.ndarray) -> None:
        self.masks = masks
        inside = coarse(masks, np.min)
        outlines = coarse(masks, np.max)
        outlines &= ~ndimage.binary_erosion(outlines, ndimage.generate_binary_structure(2, 1)[None])
        distance = np.stack([ndimage.distance_transform_edt(~outline) for outline in outlines])
        touch = -((np.minimum(distance, FARTHEST) / SPREAD) ** 2) / 2
        free = -FREE_PIXEL * inside
        evidence = [
            np.concatenate(
                [orient(part, turn).reshape(len(masks), -1) for part in (touch, free)], 1
            )
            for turn in range(ORIENTATIONS)
        ]
        self.evidence = torch.from_numpy(np.concatenate(evidence).astype(np.float32)).T

    def weights(self, explorations: Explorations) -> Tensor:
        """How probable each shape is after what was felt, (N, 8n) float64; rows sum to 1."""
        felt = np.stack([coarse(explorations.touches), coarse(explorations.free)], axis=1)
        flat = torch.from_numpy(felt.reshape(len(felt), -1).astype(np.float32))
        return torch.softmax((flat @ self.evidence).double(), dim=1)

    def draw(self, explorations: Explorations, count: int, rng: np.random.Generator) -> np.ndarray:
        """`count` shapes for each exploration, drawn by their weights, (N, count, R, R) bool."""
        reached = self.weights(explorations).cumsum(dim=1)
        # One draw for each of `count` equal parts: fewer chance repeats than independent ones.
        levels = (np.arange(count) + rng.random((len(reached), 1))) / count
        drawn = torch.searchsorted(reached, torch.from_numpy(levels) * reached[:, -1:]).numpy()
        turns, shapes = np.divmod(np.minimum(drawn, reached.shape[1] - 1), len(self.masks))
        recalled = self.masks[shapes]
        for turn in range(1, ORIENTATIONS):
            recalled[turns == turn] = orient(recalled[turns == turn], turn)
        return recalled


def coarse(images: np.ndarray, reduce: Callable[..., np.ndarray] = np.max) -> np.ndarray:
    """The middle half of images (N, R, R) as (N, C, C): above `COARSEST`, square blocks of pixels
    are reduced to one."""
    resolution = images.shape[-1]
    margin, block = resolution // 4, 1
    while resolution >= 2 * COARSEST * block:
        block *= 2
    side = resolution // 2 // block
    window = images[:, margin:-margin, margin:-margin]
    return reduce(window.reshape(len(images), side, block, side, block), axis=(2, 4))


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
