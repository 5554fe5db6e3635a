"""The rules behind the reference policies: what a trained policy has to beat, and may hope for.

Each gives the next ray (alpha, beta) of N explorations, (N, 2) int into `circle_pixels`.
"""

import numpy as np
from scipy import ndimage

from tactile_core.exploration.world.circle import angle_index, circle_pixels, middle
from tactile_core.exploration.world.rays import candidate_rays, pixels_along
from tactile_core.exploration.world.state import Explorations
from tactile_core.reconstruction.jaccard import THRESHOLD, jaccard_index

GOLDEN = (np.sqrt(5) - 1) / 2

# The oracle tries touches in portions of so many pixels, to bound its memory.
PIXELS_AT_A_TIME = 2**26


def random(explorations: Explorations, rng: np.random.Generator) -> np.ndarray:
    """Any alpha and any beta (the report's random policy, section VII)."""
    pixels = len(circle_pixels(explorations.resolution))
    return rng.integers(pixels, size=(len(explorations), 2))


def even(explorations: Explorations, rng: np.random.Generator) -> np.ndarray:
    """Rays through the centre, each turned by the golden ratio of a circle from the last."""
    return towards_middle(2 * np.pi * GOLDEN * explorations.rays, explorations.resolution)


def towards_middle(angles: np.ndarray, resolution: int) -> np.ndarray:
    """Rays from each angle (N,) of the circle through its centre, (N, 2) int."""
    return np.stack([angle_index(angles, resolution), angle_index(angles + np.pi, resolution)], 1)


def coverage(explorations: Explorations, rng: np.random.Generator) -> np.ndarray:
    """Towards the predicted centroid, through the predicted outline's point farthest from all
    touches held.

    A ray that gains no touch changes little or nothing in the prediction; the next one then
    goes on to the point farthest from those already tried as well.
    """
    return np.stack([_cover(explorations, index) for index in range(len(explorations))])


def _cover(explorations: Explorations, index: int) -> np.ndarray:
    predicted = explorations.predictions[index] > THRESHOLD
    if not predicted.any():
        return even_ray(explorations, index)
    outline = np.argwhere(predicted & ~ndimage.binary_erosion(predicted))
    centroid = np.argwhere(predicted).mean(axis=0)
    touches = np.argwhere(explorations.touches[index])
    avoided = touches if len(touches) else centroid[None]
    for _ in range(explorations.wasted[index] + 1):
        gaps = np.linalg.norm(outline[:, None] - avoided[None], axis=2).min(axis=1)
        target = outline[gaps.argmax()]
        avoided = np.concatenate([avoided, target[None]])
    return ray_through(target, centroid, explorations.resolution)


def even_ray(explorations: Explorations, index: int) -> np.ndarray:
    """The ray of `even` for one exploration, (2,) int: where nothing is predicted."""
    angle = np.array([2 * np.pi * GOLDEN * explorations.rays[index]])
    return towards_middle(angle, explorations.resolution)[0]


def ray_through(target: np.ndarray, centroid: np.ndarray, resolution: int) -> np.ndarray:
    """The ray (2,) int that passes `target` and then `centroid`, both (row, column)."""
    direction = target - centroid
    length = np.linalg.norm(direction)
    direction = direction / length if length > 0 else np.array([1.0, 0.0])
    radius = middle(resolution)
    start = centroid - middle(resolution)
    along = start @ direction
    half = np.sqrt(max(radius**2 - start @ start + along**2, 0.0))
    ends = np.stack([start + (half - along) * direction, start - (half + along) * direction])
    return angle_index(np.arctan2(ends[:, 1], ends[:, 0]), resolution)


def uncertainty(explorations: Explorations, rng: np.random.Generator) -> np.ndarray:
    """The candidate ray whose touch is expected where the reconstruction is least certain.

    A ray's score is Σ_k reach_k · p_k · H(p_k) over its pixels k: the entropy H where it
    would touch, weighted by the chance to touch there. What past rays have shown counts as
    known. Report, section II: references [4] and [6] touch where uncertainty is highest.
    """
    candidates = candidate_rays(explorations.resolution).reshape(-1, 2)
    known = np.where(explorations.free == 1, 0.0, explorations.predictions)
    known = np.where(explorations.touches == 1, 1.0, known)
    lines = pixels_along(explorations.resolution)  # (rays, L), −1 beyond the end
    chosen = [_most_uncertain(some.ravel(), lines) for some in known]
    return candidates[chosen]


def _most_uncertain(probabilities: np.ndarray, lines: np.ndarray) -> int:
    touch = np.append(probabilities, 0.0)[lines]
    clear = np.cumprod(1 - touch, axis=1)
    reach = np.concatenate([np.ones((len(lines), 1)), clear[:, :-1]], axis=1)
    sure = np.clip(touch, 1e-9, 1 - 1e-9)
    entropy = -sure * np.log(sure) - (1 - sure) * np.log(1 - sure)
    return int((reach * touch * entropy).sum(axis=1).argmax())


def oracle(explorations: Explorations, rng: np.random.Generator) -> np.ndarray:
    """The candidate ray whose touch raises the true Jaccard index most: it knows the mask.

    Of the rays that lead to one touch it tries the first.
    """
    owners, rays, hits, touches = explorations.try_candidates()
    new = np.flatnonzero(touches >= 0)
    tried = new[np.unique(touches[new], return_index=True)[1]]  # one ray for each new touch
    gains = _jaccard_with(explorations, owners[tried], rays[tried], hits[tried])
    best = np.arange(len(explorations)) * (len(rays) // len(explorations))
    order = np.lexsort((-gains, owners[tried]))
    which, position = np.unique(owners[tried][order], return_index=True)
    best[which] = tried[order][position]
    return rays[best]


def _jaccard_with(
    explorations: Explorations, owners: np.ndarray, rays: np.ndarray, hits: np.ndarray
) -> np.ndarray:
    """Jaccard index (T,) of explorations `owners` (T,) had each cast one ray (T, 2) more."""
    portion = max(1, PIXELS_AT_A_TIME // explorations.resolution**2)
    scores = []
    for start in range(0, len(owners), portion):
        some = slice(start, start + portion)
        felt = explorations.felt_after(owners[some], rays[some], hits[some])
        predictions = explorations.reconstructor.predict(felt)
        scores.append(jaccard_index(predictions, explorations.masks[owners[some]]))
    return np.concatenate(scores) if scores else np.zeros(0, np.float32)
