"""Masks a bit for each pixel, until somebody asks for them: 205 000 at 256×256 take 400 MB."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd

from tactile_core.dataset.rendering.pictures import decoded, portions


@dataclass(frozen=True)
class PackedMasks:
    """N masks, indexed as an array (N, R, R) bool would be: `masks[3]`, `masks[[5, 2]]`,
    `masks[10:20]`.

    bits : (N, S²/8) uint8, the window of every mask
    window : rows and columns outside of which no mask has a pixel, S of them
    """

    bits: np.ndarray
    resolution: int
    window: slice

    def __len__(self) -> int:
        return len(self.bits)

    @property
    def shape(self) -> tuple[int, int, int]:
        return len(self), self.resolution, self.resolution

    def __getitem__(self, which: int | slice | np.ndarray) -> np.ndarray:
        bits = self.bits[which]
        size = len(range(self.resolution)[self.window])
        inner = np.unpackbits(bits, axis=-1, count=size**2).view(bool)
        masks = np.zeros((*bits.shape[:-1], self.resolution, self.resolution), bool)
        masks[..., self.window, self.window] = inner.reshape(*bits.shape[:-1], size, size)
        return masks

    def select(self, indices: np.ndarray) -> "PackedMasks":
        """The masks at `indices`, in that order."""
        return PackedMasks(self.bits[indices], self.resolution, self.window)

    def portions(self) -> Iterator[np.ndarray]:
        """All masks in order, some at a time, (n, R, R) bool."""
        return (self[some] for some in portions(len(self)))


Masks = np.ndarray | PackedMasks  # (N, R, R) bool


def pack_masks(masks: np.ndarray) -> PackedMasks:
    """Masks (N, R, R) bool."""
    return packed(lambda: (masks[some] for some in portions(len(masks))))


def pack_pictures(pictures: pd.Series) -> PackedMasks:
    """PNG bytes of N masks of one resolution; raises `TactileError` where one cannot be read."""
    return packed(lambda: decoded(pictures))


def packed(read: Callable[[], Iterator[np.ndarray]]) -> PackedMasks:
    """The masks that `read` reads, some at a time. Shapes lie in the middle half of an image, so
    that is all that is kept, unless one has a pixel outside."""
    bits = []
    for masks in read():
        resolution = masks.shape[-1]
        window = slice(resolution // 4, resolution - resolution // 4)
        inner = masks[:, window, window]
        if np.count_nonzero(inner) < np.count_nonzero(masks):
            window = slice(None)
            bits = [packed_bits(every) for every in read()]
            break
        bits.append(packed_bits(inner))
    return PackedMasks(np.concatenate(bits), resolution, window)


def packed_bits(masks: np.ndarray) -> np.ndarray:
    """Masks (n, S, S) bool as (n, S²/8) uint8."""
    return np.packbits(masks.reshape(len(masks), -1), axis=1)
