"""What rays would gain: many labels for every state, from shapes that are known.

On the train shapes the first touch of every candidate ray is known. So a state needs no trial
and error: the U-Net is asked what several of the possible touches would add.
"""

import numpy as np

from tactile_core.exploration.world.state import Explorations
from tactile_core.reconstruction.jaccard import jaccard_index


def find_gains(
    explorations: Explorations, tries: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """What candidate rays would add to the Jaccard index: gains (N, C) float32 in points and
    which of them are known, (N, C) bool.

    The U-Net is asked about `tries` of each exploration's possible new touches, by one ray each.
    Where it sees touches only, every ray that leads to one of them shares its gain, and rays that
    miss or repeat are known to gain 0. Where it sees free space, the way there matters as well: it
    is asked about half as many rays that miss or repeat, and only the rays tried are known.
    """
    owners, rays, hits, touches = explorations.try_candidates()  # T = N · C rays
    new = touches >= 0
    some = rng.permutation(np.flatnonzero(new))
    ways = some[np.unique(touches[some], return_index=True)[1]]  # a ray for each new touch
    # At most `tries` of each exploration, as indices into the T rays.
    tried = ways[first_of_each(owners[ways], rng.permutation(len(ways)), tries)]
    free_space = explorations.reconstructor.free_space
    if free_space:
        wasted = np.flatnonzero(~new)
        order = rng.permutation(len(wasted))
        others = wasted[first_of_each(owners[wasted], order, tries // 2)]
        tried = np.concatenate([tried, others])
    # (K, R, R) for the K rays tried, each on the touches held so far.
    felt = explorations.felt_after(owners[tried], rays[tried], hits[tried])
    predictions = explorations.reconstructor.predict(felt)
    gain = jaccard_index(predictions, explorations.masks[owners[tried]])
    gain -= explorations.jaccard[owners[tried]]  # (K,)
    gains, known = np.zeros(len(rays), np.float32), ~new
    if free_space:
        gains[tried], known = gain, np.isin(np.arange(len(rays)), tried)
    elif len(tried):
        position = np.searchsorted(touches[tried], touches).clip(max=len(tried) - 1)
        shared = new & (touches[tried][position] == touches)
        gains[shared], known = gain[position[shared]], known | shared
    count = len(explorations)
    return gains.reshape(count, -1), known.reshape(count, -1)


def first_of_each(owner: np.ndarray, order: np.ndarray, most: int) -> np.ndarray:
    """Of indices taken in `order`, the first `most` of each owner, (T,) int, sorted."""
    by_owner = order[np.argsort(owner[order], kind="stable")]
    starts = np.searchsorted(owner[by_owner], owner[by_owner])
    return np.sort(by_owner[np.arange(len(by_owner)) - starts < most])
