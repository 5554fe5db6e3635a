"""Known shapes, remembered whole and weighed by how well they agree with what was felt.

A net that completes shapes knows what is usual around a touch; what goes together far apart, it can
hardly tell from a few single pixels. Shapes that are remembered whole keep that. Both the U-Net
(`UNetSettings.known_shapes`) and the policy `recall` use them.
"""

import functools
from collections.abc import Callable, Iterator

import numpy as np
import torch
from scipy import ndimage
from torch import Tensor, nn
from torch.nn import functional

from tactile_core.dataset.packed import Masks, PackedMasks
from tactile_core.reconstruction.batches import ORIENTATIONS, orient

PACKED_SHAPES = "packed_shapes"  # what they are called beside the weights of a net

MOST = 4096  # shapes remembered; at resolution 64 each takes 72 KiB
COARSEST = 64  # resolution at which shapes and what was felt are compared
# A touch speaks against a shape by its squared distance to that shape's outline, as under a normal
# error of so many pixels; beyond the farthest, one stray touch should not rule a shape out.
SPREAD, FARTHEST = 0.7, 3.0
FREE_PIXEL = 1.0  # and every pixel inside the shape that was seen free, by so much
RULED_OUT = -1e9  # finite: where nothing else is known, all are as improbable


def picked(count: int) -> slice:
    """Which of `count` shapes to remember: at most `MOST`, evenly."""
    return slice(None, None, -(-count // MOST))


def pack(masks: Masks) -> np.ndarray:
    """Masks (N, R, R), or as many of them as are remembered, as (n, R²/8) uint8."""
    return bits_of(masks[picked(len(masks))])


def bits_of(masks: np.ndarray) -> np.ndarray:
    """Masks (N, R, R) bool, a bit for each pixel, (N, R²/8) uint8."""
    return np.packbits(masks.reshape(len(masks), -1), axis=1)


def models_of(packed: np.ndarray, masks: PackedMasks, model_ids: np.ndarray) -> np.ndarray:
    """The models (n,) str that packed masks (n, R²/8) are of, found among `masks` of `model_ids`
    (N,); "" where it is none of them."""
    wanted = {row.tobytes() for row in packed}
    known = {
        row: model for row, model in zip(rows_of(masks), model_ids, strict=True) if row in wanted
    }
    return np.array([known.get(row.tobytes(), "") for row in packed], dtype=str)


def rows_of(masks: PackedMasks) -> Iterator[bytes]:
    """Each mask as `pack` packs it."""
    return (row.tobytes() for some in masks.portions() for row in bits_of(some))


def unpack(packed: np.ndarray, resolution: int) -> np.ndarray:
    """The masks (n, R, R) bool that `pack` packed."""
    bits = np.unpackbits(packed, axis=1).astype(bool)
    return bits.reshape(len(packed), resolution, resolution)


class KnownShapes(nn.Module):
    """Shapes to recall, each in eight orientations: 8n in all.

    Shapes and what was felt are compared at C·C cells in the middle half of the image. Every shape
    is kept in its first orientation only: rather than the shapes, what was felt is turned.

    masks : (n, R, R) bool
    models : (n,) str, whose masks they are; None where nobody asks
    touch : (C², n), what a touch in each cell adds to each shape's log-likelihood
    free : (n, C²/4), what each pixel that was seen free adds, for cells in blocks of four
    inside : (n, C²), how much of each cell lies inside the shape, 0–1
    """

    touch: Tensor
    free: Tensor
    inside: Tensor

    def __init__(
        self,
        masks: np.ndarray,
        models: np.ndarray | None = None,
        spread: float = SPREAD,
        farthest: float = FARTHEST,
    ) -> None:
        super().__init__()
        self.masks, self.models = masks, models
        every = torch.from_numpy(masks).float()
        within = -coarse(-every)  # cells that lie inside as a whole
        covered = coarse(every).numpy() > 0
        cross = ndimage.generate_binary_structure(2, 1)[None]
        outlines = covered & ~ndimage.binary_erosion(covered, cross)
        distance = np.stack([ndimage.distance_transform_edt(~outline) for outline in outlines])
        share = coarse(every, functional.avg_pool2d)
        touch = torch.from_numpy(-((np.minimum(distance, farthest) / spread) ** 2) / 2)
        blocks = -functional.max_pool2d(-within[:, None], 2)
        self.register_buffer("touch", touch.float().flatten(1).T.contiguous(), persistent=False)
        self.register_buffer("free", -FREE_PIXEL * blocks.flatten(1), persistent=False)
        self.register_buffer("inside", share.flatten(1), persistent=False)

    def weights(self, felt: Tensor, models: np.ndarray | None = None) -> Tensor:
        """How probable each shape is after what was felt, (N, 8n) float32, orientation by
        orientation; rows sum to 1.

        felt : (N, R, R), 1 at a touch, 0 where nothing is known, −1 where a ray has passed
        models : (N,) str; shapes of the model itself are not recalled
        """
        touched = turned_back(coarse((felt > 0).float()))  # (8N, C²)
        which, cells = touched.nonzero(as_tuple=True)  # (T,) each: every touch of every image
        firsts = torch.searchsorted(which, torch.arange(len(touched), device=felt.device))
        evidence = functional.embedding_bag(cells, self.touch, firsts, mode="sum")  # (8N, n)
        # Pixels seen free in each block of 2×2 cells, (N, C/2, C/2).
        passed = 4 * functional.avg_pool2d(coarse((felt < 0).float()), 2)
        evidence = (evidence + turned_back(passed).to(self.free.dtype) @ self.free.T).float()
        evidence = evidence.reshape(len(felt), -1)  # (N, 8n)
        if models is not None:
            assert self.models is not None
            own = torch.from_numpy(models[:, None] == self.models).to(felt.device)  # (N, n)
            evidence = evidence.masked_fill(own.repeat(1, ORIENTATIONS), RULED_OUT)
        return torch.softmax(evidence, dim=1)

    def mean(self, felt: Tensor, models: np.ndarray | None = None) -> Tensor:
        """The mean of the shapes by their weights, (N, R, R) in 0–1; arguments as of `weights`."""
        resolution = felt.shape[-1]
        weights = self.weights(felt, models).to(self.inside.dtype)
        inside = weights.reshape(-1, len(self.inside)) @ self.inside  # (8N, C²)
        side = int(inside.shape[1] ** 0.5)
        mean = turned(inside.reshape(len(felt), ORIENTATIONS, -1), side).sum(dim=1)  # (N, C²)
        window = functional.interpolate(
            mean.reshape(len(felt), 1, side, side), size=(resolution // 2,) * 2
        )
        return functional.pad(window[:, 0], [resolution // 4] * 4)

    def draw(self, felt: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
        """`count` shapes for each of N, drawn by their weights, (N, count, R, R) bool.

        felt : (N, R, R) int8, as for `weights`
        """
        reached = self.weights(torch.from_numpy(felt)).double().cumsum(dim=1)  # (N, 8n)
        # One draw for each of `count` equal parts: fewer chance repeats than independent ones.
        levels = (np.arange(count) + rng.random((len(reached), 1))) / count
        drawn = torch.searchsorted(reached, torch.from_numpy(levels) * reached[:, -1:]).numpy()
        turns, shapes = np.divmod(np.minimum(drawn, reached.shape[1] - 1), len(self.masks))
        recalled = self.masks[shapes]
        for turn in range(1, ORIENTATIONS):
            recalled[turns == turn] = orient(recalled[turns == turn], turn)
        return recalled


def coarse(images: Tensor, pool: Callable[..., Tensor] = functional.max_pool2d) -> Tensor:
    """The middle half of images (N, R, R) as (N, C, C): above `COARSEST`, square blocks of pixels
    are pooled to one."""
    resolution = images.shape[-1]
    margin, block = resolution // 4, 1
    while resolution >= 2 * COARSEST * block:
        block *= 2
    window = images[:, None, margin : resolution - margin, margin : resolution - margin]
    return pool(window, block)[:, 0]


def turned_back(images: Tensor) -> Tensor:
    """Images (N, C, C) as they look where a shape in each orientation is turned back to its first,
    (8N, C²)."""
    return images.flatten(1)[:, cells_back(images.shape[-1]).to(images.device)].flatten(0, 1)


def turned(images: Tensor, side: int) -> Tensor:
    """Images (N, 8, C²), each of the eight turned into its orientation."""
    return images.gather(2, cells_by_turn(side).to(images.device).expand(images.shape))


@functools.cache
def cells_by_turn(side: int) -> Tensor:
    """Which cell of C·C comes to lie in each cell of every orientation, (8, C²) int64."""
    cells = np.arange(side * side).reshape(1, side, side)
    return torch.from_numpy(
        np.concatenate([orient(cells, turn).reshape(1, -1) for turn in range(ORIENTATIONS)])
    )


@functools.cache
def cells_back(side: int) -> Tensor:
    """Where each cell of C·C has come to lie in every orientation, (8, C²) int64: the way back."""
    return cells_by_turn(side).argsort(dim=1)
