"""Copies: the same object under several names, which must not be trained on and tested on.

ShapeNet holds meshes twice, byte for byte, with another header or vertex order, or a little
changed. What counts here is what a robot could feel: objects whose silhouettes at the canonical
pose are the same, or nearly, are copies too.
"""

import numpy as np
import pandas as pd
from scipy import sparse
from scipy.sparse import csgraph

from tactile_core.compiled import compiled
from tactile_core.dataset.rendering.pictures import decode_masks

# Of the pixels that either of two silhouettes covers, so many must be covered by both. Different
# mugs and bottles reach 0.993 at 64×64.
SAME_SILHOUETTE = 0.995
BITS = np.array([bin(byte).count("1") for byte in range(256)], dtype=np.int64)


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

    Such have nearly the same area: only those are compared, so it takes little more than the
    sorting of all areas.
    """
    rows = np.flatnonzero(pictures.notna())
    if len(rows) < 2:
        return []
    masks = decode_masks(pictures.iloc[rows])  # (N, R, R)
    packed = np.packbits(masks.reshape(len(masks), -1), axis=1)  # (N, R²/8)
    areas = masks.sum(axis=(1, 2))
    order = np.argsort(areas, kind="stable")
    sorted_areas = areas[order].astype(np.int64)
    found = _near_pairs(packed[order], sorted_areas, SAME_SILHOUETTE, BITS)
    return [(int(a), int(b)) for a, b in rows[order[found]].reshape(-1, 2)]


@compiled
def _near_pairs(
    packed: np.ndarray, areas: np.ndarray, least: float, ones: np.ndarray
) -> np.ndarray:
    """Pairs (K, 2) of masks, sorted by area, whose Jaccard index (0–1) is `least` or more.

    ones : (256,) how many bits of each byte are set
    """
    found = []
    for one in range(len(areas)):
        for other in range(one + 1, len(areas)):
            if areas[one] < least * areas[other]:
                break
            both = 0
            for byte in range(packed.shape[1]):
                both += ones[packed[one, byte] & packed[other, byte]]
            if both >= least * (areas[one] + areas[other] - both):
                found.append((one, other))
    pairs = np.empty((len(found), 2), np.int64)
    for number in range(len(found)):
        pairs[number, 0], pairs[number, 1] = found[number]
    return pairs
