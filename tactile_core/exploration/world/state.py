"""Many explorations in step: the batched heart of training and evaluation (report, VI.A)."""

import copy
from dataclasses import dataclass

import numpy as np

from tactile_core.errors import TactileError
from tactile_core.exploration.world.rays import candidate_rays, cast_rays, mark_free
from tactile_core.reconstruction.inference import Reconstructor
from tactile_core.reconstruction.jaccard import jaccard_index

EVERY = slice(None)
ARRAYS = ("masks", "touches", "free", "predictions", "jaccard", "held", "rays", "wasted")


@dataclass(frozen=True)
class Cast:
    """What one ray did in each of N explorations.

    touches : (N, 2) int16 (row, column); (−1, −1) for a miss
    missed, repeated : (N,) bool
    jaccard_before, jaccard : (N,) float32, Jaccard index (0–100) before and after the ray; an
        exploration that has cast no ray counts as 0 before it
    """

    touches: np.ndarray
    missed: np.ndarray
    repeated: np.ndarray
    jaccard_before: np.ndarray
    jaccard: np.ndarray


class Explorations:
    """N robots, each feeling out a mask of its own.

    masks : (N, R, R) bool, what is felt; only rays and the oracle look at it
    touches : (N, R, R) uint8, 1 at every touch held
    free : (N, R, R) uint8, 1 where a past ray passed before its touch
    predictions : (N, R, R) float32, probability of the object as reconstructed
    jaccard : (N,) float32, Jaccard index (0–100) of prediction and mask
    held, rays, wasted : (N,) int, touches held, rays cast, and rays since the last new touch
    """

    def __init__(self, masks: np.ndarray, reconstructor: Reconstructor) -> None:
        check_resolution(masks, reconstructor)
        self.reconstructor = reconstructor
        self.masks = np.array(masks)
        self.touches = np.zeros(masks.shape, np.uint8)
        self.free = np.zeros(masks.shape, np.uint8)
        self.predictions = np.empty(masks.shape, np.float32)
        self.jaccard = np.empty(len(masks), np.float32)
        self.held = np.zeros(len(masks), int)
        self.rays = np.zeros(len(masks), int)
        self.wasted = np.zeros(len(masks), int)
        self.restart(np.arange(len(masks)), masks)

    def __len__(self) -> int:
        return len(self.masks)

    @property
    def resolution(self) -> int:
        return self.masks.shape[-1]

    def restart(self, which: np.ndarray, masks: np.ndarray) -> None:
        """Begin the explorations at indices `which` anew, on `masks` (len(which), R, R)."""
        self.masks[which] = masks
        self.touches[which] = 0
        self.free[which] = 0
        self.predictions[which] = self.reconstructor.untouched
        self.jaccard[which] = jaccard_index(self.reconstructor.untouched, masks)
        self.held[which] = 0
        self.rays[which] = 0
        self.wasted[which] = 0

    def cast(self, rays: np.ndarray) -> Cast:
        """Cast one ray (alpha, beta) in each exploration, (N, 2) int, and reconstruct.

        Only explorations in which more was felt pass through the U-Net: those that gained a
        touch and, where the U-Net sees free space, those whose ray passed through new pixels.
        """
        touches = cast_rays(self.masks, rays)
        freed = mark_free(self.free, rays, touches)
        missed = touches[:, 0] < 0
        rows, columns = touches.T
        repeated = ~missed & (self.touches[np.arange(len(self)), rows, columns] == 1)
        new = ~missed & ~repeated
        gained = np.flatnonzero(new)
        before = np.where(self.rays == 0, np.float32(0), self.jaccard)
        self.rays += 1
        self.held[gained] += 1
        self.wasted += 1
        self.wasted[gained] = 0
        self.touches[gained, rows[gained], columns[gained]] = 1
        changed = new | (freed > 0) if self.reconstructor.free_space else new
        if changed.any():
            self.predictions[changed] = self.predict(changed, touches)
            self.jaccard[changed] = jaccard_index(self.predictions[changed], self.masks[changed])
        return Cast(touches, missed, repeated, before, self.jaccard.copy())

    def predict(self, which: np.ndarray, touches: np.ndarray) -> np.ndarray:
        """Predictions, (n, R, R) float32, of the n explorations that `which` (N,) bool selects.

        touches : (N, 2) int16, the latest ones; where the U-Net sees nothing but one touch, its
            prediction is looked up
        """
        table = None if self.reconstructor.free_space else self.reconstructor.single_touches
        if table is None:
            return self.reconstructor.predict(self.felt(which))
        places = touches[which] - self.resolution // 4
        inside = ((places >= 0) & (places < self.resolution // 2)).all(axis=1)
        single = inside & (self.held[which] == 1)
        predictions = np.empty((len(single), *self.predictions.shape[1:]), np.float32)
        predictions[single] = table[tuple(places[single].T)]
        predictions[~single] = self.reconstructor.predict(self.felt(which)[~single])
        return predictions

    def felt(self, which: np.ndarray | slice = EVERY) -> np.ndarray:
        """What the U-Net sees, (N, R, R) int8: 1 at a touch, −1 at free space if it sees that."""
        return felt_images(self.touches[which], self.free[which], self.reconstructor)

    def felt_after(self, owners: np.ndarray, rays: np.ndarray, touches: np.ndarray) -> np.ndarray:
        """What the U-Net would see, (T, R, R) int8, had each of `owners` (T,) cast one ray more.

        rays : (T, 2) int, any ray for each; touches : (T, 2) int16, what it meets
        """
        held, free = self.touches[owners], self.free[owners]
        if self.reconstructor.free_space:
            mark_free(free, rays, touches)
        hit = np.flatnonzero(touches[:, 0] >= 0)
        held[hit, touches[hit, 0], touches[hit, 1]] = 1
        return felt_images(held, free, self.reconstructor)

    def try_candidates(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Where each of C candidate rays would end in each exploration, without casting it.

        Returns, for T = N · C rays in the order of their explorations: whose they are (T,), the
        rays (T, 2), what they meet (T, 2), and a number (T,) for the new touch that each would
        bring: rays of one exploration with the same touch share it, numbers rise with the
        exploration, and −1 stands for a miss or a repeat.
        """
        candidates = candidate_rays(self.resolution).reshape(-1, 2)
        owners = np.repeat(np.arange(len(self)), len(candidates))
        rays = np.tile(candidates, (len(self), 1))
        hits = cast_rays(self.masks, rays, owners)
        rows, columns = hits.T.astype(int)
        new = (rows >= 0) & (self.touches[owners, rows, columns] == 0)
        pixels = (owners * self.resolution + rows) * self.resolution + columns
        return owners, rays, hits, np.where(new, pixels, -1)

    def observations(self, which: np.ndarray | slice = EVERY) -> np.ndarray:
        """What a policy sees, (N, 2, R, R) uint8: the reconstruction and the touches, 0–255."""
        touches = self.touches[which] * np.uint8(255)
        return np.stack([to_grey(self.predictions[which]), touches], axis=1)

    def select(self, which: np.ndarray) -> "Explorations":
        """The explorations at indices `which`, on their own from here on."""
        chosen = copy.copy(self)
        for name in ARRAYS:
            setattr(chosen, name, getattr(self, name)[which].copy())
        return chosen

    def get_state(self) -> dict[str, np.ndarray]:
        """All arrays by name, copied."""
        return {name: getattr(self, name).copy() for name in ARRAYS}

    def set_state(self, state: dict[str, np.ndarray]) -> None:
        """Go on from what `get_state` returned."""
        for name in ARRAYS:
            getattr(self, name)[...] = state[name]


def check_resolution(masks: np.ndarray, reconstructor: Reconstructor) -> None:
    """Raises `TactileError` where masks (N, R, R) are not of the U-Net's resolution."""
    if masks.shape[-1] != reconstructor.resolution:
        raise TactileError(
            f"masks of resolution {masks.shape[-1]} cannot be explored with a U-Net that was "
            f"trained at {reconstructor.resolution}: take those of one resolution"
        )


def felt_images(touches: np.ndarray, free: np.ndarray, reconstructor: Reconstructor) -> np.ndarray:
    """Touches and free space, (N, R, R) uint8 each, as the U-Net of `reconstructor` sees them."""
    felt = touches.astype(np.int8)
    return felt - free.astype(np.int8) if reconstructor.free_space else felt


def to_grey(probabilities: np.ndarray) -> np.ndarray:
    """Probabilities 0–1 as uint8 grey values 0–255."""
    grey = probabilities * np.float32(255)
    return np.rint(grey, out=grey).astype(np.uint8)
