"""What rays feel, for training the U-Net on what it will meet.

Rays touch what they see from outside first, so their touches lie otherwise than a uniform draw
from the outline. A part of each batch stays uniform, as in the report (section V).
"""

from typing import NamedTuple

import numpy as np
import pandas as pd

from tactile_core.dataset.rendering.pictures import portions
from tactile_core.dataset.shapes import Shapes
from tactile_core.errors import TactileError
from tactile_core.exploration.policies.rules import GOLDEN, towards_middle
from tactile_core.exploration.world.circle import circle_pixels
from tactile_core.exploration.world.rays import RAYS, candidate_rays, cast_rays, mark_free
from tactile_core.files import content_hash
from tactile_core.keys import work_key
from tactile_core.reconstruction.batches import (
    TouchSource,
    outline_source,
    outline_touches,
    touch_images,
)
from tactile_core.reconstruction.stored_touches import stored_touches
from tactile_core.settings import Touches

SEQUENCES = 8  # of each kind for each shape


class RaySequences(NamedTuple):
    """Ten rays in a row, S times for each of N shapes.

    rays : (N, S, RAYS, 2) int, (alpha, beta)
    touches : (N, S, RAYS, 2) int16, (row, column); (−1, −1) for a miss
    """

    rays: np.ndarray
    touches: np.ndarray

    @property
    def version(self) -> str:
        """Hash of all rays and touches (16 hex digits)."""
        return content_hash(self.rays.shape, self.rays.tobytes(), self.touches.tobytes())


def practised(practice_rays: pd.DataFrame, shapes: Shapes) -> RaySequences:
    """The rays that `practise` recorded, in the order of `shapes`.

    Raises `TactileError` where they were recorded on other samples, or on other masks of the same
    names: each ray has to touch what it touched.
    """
    table = practice_rays.set_index(["sample_id", "sequence"])
    wanted = pd.MultiIndex.from_product(
        [shapes.sample_ids, sorted(practice_rays["sequence"].unique())]
    )
    others = TactileError(
        "practice_rays were recorded on other train samples than those in rotated_splits: "
        "materialise practice_rays again"
    )
    if len(wanted) != len(table) or not wanted.isin(table.index).all():
        raise others
    table = table.loc[wanted]
    shape = len(shapes), -1, RAYS, 2
    rays = np.stack(table["rays"].to_list()).astype(int).reshape(shape)  # (N, S, RAYS, 2)
    touches = np.stack(table["touches"].to_list()).astype(np.int16).reshape(shape)
    if rays.max() >= len(circle_pixels(shapes.resolution)):  # of a larger resolution
        raise others
    if (cast_at(shapes, rays) != touches).any():
        raise others
    return RaySequences(rays, touches)


def touch_source(
    kind: Touches,
    shapes: Shapes,
    tactile_samples: pd.DataFrame,
    *,
    seed: int,
    free_space: bool = False,
    practice: RaySequences | None = None,
) -> TouchSource:
    """The touches that a U-Net learns from, as its settings name them.

    Raises `TactileError` where there is practice and `kind` has no use for it.
    """
    if practice and kind != "rays":
        raise TactileError(f"touches {kind!r} leave practice_rays unused: choose 'rays'")
    match kind:
        case "stored":
            return stored_touches(shapes, tactile_samples)
        case "outline":
            return outline_source(shapes)
        case "rays":
            return rays_and_outlines(shapes, seed, free_space, practice)


def rays_and_outlines(
    shapes: Shapes, seed: int, free_space: bool, practice: RaySequences | None = None
) -> TouchSource:
    """Draws images of outline touches, of what plain rays felt, and of `practice` if there is
    any: as many of each.

    An image of rays shows what the first 1–10 of a sequence felt; rays that miss leave fewer
    touches. With `free_space` it also shows where these rays passed.
    """
    uniform = outline_touches(shapes)
    plain = plain_sequences(shapes, np.random.default_rng(seed))
    sources = [plain, practice] if practice else [plain]

    def draw(rng: np.random.Generator, indices: np.ndarray) -> np.ndarray:
        points, held = uniform(rng, indices)
        cast = np.arange(RAYS) < rng.integers(1, RAYS + 1, (len(indices), 1))
        source = rng.integers(len(sources) + 1, size=len(indices))
        rays = np.zeros((len(indices), RAYS, 2), int)
        for number, sequences in enumerate(sources, start=1):
            which = np.flatnonzero(source == number)
            chosen = indices[which], rng.integers(sequences.rays.shape[1], size=len(which))
            rays[which], points[which] = sequences.rays[chosen], sequences.touches[chosen]
            held[which] = cast[which] & (points[which, :, 0] >= 0)
        images = touch_images(points, held, shapes.resolution)
        if free_space:
            by_rays = cast & (source > 0)[:, None]
            images -= free_images(rays, points, by_rays, shapes.resolution)
        return images

    key = work_key(
        "exploration.practice.ray_touches",
        settings={"free_space": free_space},
        seed=seed,
        practice=practice.version if practice else "none",
    )
    return TouchSource(draw, key)


def free_images(
    rays: np.ndarray, touches: np.ndarray, cast: np.ndarray, resolution: int
) -> np.ndarray:
    """Where rays (B, K, 2) passed before their touches (B, K, 2), (B, R, R) int8, 0 or 1.

    cast : (B, K) bool, which of the rays count
    """
    free = np.zeros((len(rays), resolution, resolution), np.uint8)
    for ray in range(rays.shape[1]):
        which = np.flatnonzero(cast[:, ray])
        some = free[which]
        mark_free(some, rays[which, ray], touches[which, ray])
        free[which] = some
    return free.astype(np.int8)


def plain_sequences(shapes: Shapes, rng: np.random.Generator) -> RaySequences:
    """Candidate rays at random, sweeps through the middle from any angle, and mixtures of both."""
    count = len(shapes) * SEQUENCES * RAYS
    candidates = candidate_rays(shapes.resolution).reshape(-1, 2)
    at_random = candidates[rng.integers(len(candidates), size=count)]
    start = rng.uniform(0, 2 * np.pi, (len(shapes), SEQUENCES, 1))
    angles = start + 2 * np.pi * GOLDEN * np.arange(RAYS)
    sweeps = towards_middle(angles.ravel(), shapes.resolution)
    mixed = np.where(rng.random((count, 1)) < 0.5, at_random, sweeps)
    shape = len(shapes), SEQUENCES, RAYS, 2
    rays = np.concatenate([some.reshape(shape) for some in (at_random, sweeps, mixed)], axis=1)
    return RaySequences(rays, cast_at(shapes, rays))


def cast_at(shapes: Shapes, rays: np.ndarray) -> np.ndarray:
    """Touches (N, S, RAYS, 2) int16 of the rays (N, S, RAYS, 2) of each of N shapes."""
    touches = np.empty(rays.shape, np.int16)
    for some in portions(len(shapes)):
        masks, own = shapes.packed[some], rays[some]
        owners = np.repeat(np.arange(len(masks)), own[0].size // 2)
        touches[some] = cast_rays(masks, own.reshape(-1, 2), owners).reshape(own.shape)
    return touches
