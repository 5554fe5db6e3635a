"""Copies: the same object under several names, which must not be trained on and tested on.

ShapeNet holds meshes twice, byte for byte, with another header or vertex order, or a little
changed. What counts here is what a robot could feel: objects whose silhouettes at the canonical
pose are the same, or nearly, are copies too.
"""

import numba
import numpy as np
import pandas as pd
from scipy import sparse
from scipy.sparse import csgraph

from tactile_core.compiled import compiled
from tactile_core.dataset.packed import pack_pictures

# Of the pixels that either of two silhouettes covers, so many must be covered by both. Different
# mugs and bottles reach 0.993 at 64×64.
SAME_SILHOUETTE = 0.995


def find_copies(masks: pd.DataFrame) -> pd.Series:
    """For each row of `masks` (model_id, content_hash, geometry, mask) the first model id, by name,
    of the objects that it is one with; its own where it has no copy."""
    pairs = [
        *equal_pairs(masks["content_hash"]),
        *equal_pairs(masks["geometry"]),
        *same_silhouettes(masks["mask"]),
    ]
    one, other = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    edges = sparse.coo_matrix((np.ones(len(one)), (one, other)), shape=(len(masks),) * 2)
    _, objects = csgraph.connected_components(edges, directed=False)
    names = pd.Series(masks["model_id"].to_numpy(dtype=str), index=masks.index)
    return names.groupby(objects).transform("min")


def equal_pairs(values: pd.Series) -> list[tuple[int, int]]:
    """Positions of each value's first row and of every further one."""
    places = pd.Series(np.arange(len(values)), index=values.index)
    firsts = places.groupby(values.to_numpy()).transform("first")
    return [(int(a), int(b)) for a, b in zip(firsts, places, strict=True) if a != b]


def same_silhouettes(pictures: pd.Series) -> list[tuple[int, int]]:
    """Pairs of rows whose masks are nearly the same; rows without a mask are in none.

    Such have nearly the same area: only those are compared, and only until they differ by too much.
    """
    rows = np.flatnonzero(pictures.notna())
    if len(rows) < 2:
        return []
    masks = pack_pictures(pictures.iloc[rows])
    areas = np.concatenate([some.sum(axis=(1, 2)) for some in masks.portions()])
    order = np.argsort(areas, kind="stable")
    found = _near_pairs(words(masks.bits[order]), areas[order].astype(np.int64), SAME_SILHOUETTE)
    return [(int(a), int(b)) for a, b in rows[order[found]].reshape(-1, 2)]


def words(bits: np.ndarray) -> np.ndarray:
    """Bits (N, bytes) uint8 as (N, words) uint64, padded with zeros."""
    padded = np.pad(bits, ((0, 0), (0, -bits.shape[1] % 8)))
    return np.ascontiguousarray(padded).view(np.uint64)


@compiled
def _near_pairs(masks: np.ndarray, areas: np.ndarray, least: float) -> np.ndarray:
    """Pairs (K, 2) of masks, sorted by area, whose Jaccard index (0–1) is `least` or more.

    masks : (N, words) uint64, a bit for each pixel
    """
    found = []
    for one in range(len(areas)):
        for other in range(one + 1, len(areas)):
            if areas[one] < least * areas[other]:
                break
            # Most pairs differ in more than they may within a few words.
            both_areas = areas[one] + areas[other]
            may_differ = (1 - least) / (1 + least) * both_areas + 1
            differ = np.int64(0)
            for word in range(masks.shape[1]):
                differ += _ones(masks[one, word] ^ masks[other, word])
                if differ > may_differ:
                    break
            both = (both_areas - differ) // 2
            if both >= least * (both_areas - both):
                found.append((one, other))
    pairs = np.empty((len(found), 2), np.int64)
    for number in range(len(found)):
        pairs[number, 0], pairs[number, 1] = found[number]
    return pairs


@numba.njit(inline="always")
def _ones(word: np.uint64) -> np.int64:
    """How many bits of a word are set."""
    word -= (word >> np.uint64(1)) & np.uint64(0x5555555555555555)
    twos = np.uint64(0x3333333333333333)
    word = (word & twos) + ((word >> np.uint64(2)) & twos)
    word = (word + (word >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
    return np.int64((word * np.uint64(0x0101010101010101)) >> np.uint64(56))
