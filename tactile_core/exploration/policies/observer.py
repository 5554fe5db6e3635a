"""The ideal observer: what a policy can reach that knows the distribution of shapes, not the shape.

It believes in thousands of shapes, drawn from the same distribution as those it is tried on, weighs
them by what was felt, and tries every candidate ray on draws from that belief. It is an estimate,
and from below: the belief is a sample, and it looks one or two rays ahead, no further.
"""

import functools

import numpy as np

from tactile_core.exploration.policies.base import weights_version
from tactile_core.exploration.policies.recall import all_felt, try_rays
from tactile_core.exploration.policies.scorer import RayScorer, best_rays_apart
from tactile_core.exploration.world.rays import RAYS, candidate_rays
from tactile_core.exploration.world.state import Explorations
from tactile_core.files import content_hash
from tactile_core.reconstruction.known_shapes import KnownShapes, pack

GREEDY, AHEAD = "observer", "observer_ahead"
# Shapes from the belief that the candidate rays left are tried on, and how many rays are left then:
# a race, since most rays are clearly worse than the best after a few shapes.
ROUNDS = ((6, 36), (30, 6), (128, 1))
SECOND = 6  # rays that it tries after each of those before the last round
BEYOND = 10  # shapes from the belief that it looks beyond them on, and again after each


class IdealObserver:
    """Casts the ray after which, over shapes drawn from its belief, the Jaccard index is highest.

    ahead : a ray scorer; with it the index after the next ray but one counts. It is tried for the
        rays that are left before the last of `ROUNDS`, with the `SECOND` rays that the scorer
        values most after each of them. The last of the ten rays is chosen without.
    """

    seed = 0
    draws = False

    def __init__(self, belief: KnownShapes, ahead: RayScorer | None = None) -> None:
        self.name = AHEAD if ahead else GREEDY
        self.belief = belief
        self.ahead = ahead

    @functools.cached_property
    def version(self) -> str:
        net = weights_version(self.ahead.state_dict()) if self.ahead else ""
        return content_hash(pack(self.belief.masks).tobytes(), net)

    def choose(
        self, explorations: Explorations, rng: np.random.Generator, deterministic: bool
    ) -> np.ndarray:
        chosen = [
            self.choose_one(explorations.select(np.array([index])), rng)
            for index in range(len(explorations))
        ]
        return np.stack(chosen)

    def choose_one(self, one: Explorations, rng: np.random.Generator) -> np.ndarray:
        """The next ray (2,) of a single exploration."""
        if self.ahead is None or one.rays[0] >= RAYS - 1:
            return self.best_rays(one, ROUNDS, rng)[0]
        first = self.best_rays(one, ROUNDS[:-1], rng)
        return first[self.two_ahead(one, first, self.ahead, rng).argmax()]

    def best_rays(
        self, one: Explorations, rounds: tuple[tuple[int, int], ...], rng: np.random.Generator
    ) -> np.ndarray:
        """The candidate rays (K, 2) that are left after `rounds`, best first; those that are left
        have been tried on the same shapes."""
        rays = candidate_rays(one.resolution).reshape(-1, 2)
        summed = np.zeros(len(rays))
        for shapes, left in rounds:
            summed = summed + shapes * self.expected(one, rays[None], shapes, rng)[0]
            best = np.argsort(-summed, kind="stable")[:left]
            rays, summed = rays[best], summed[best]
        return rays

    def two_ahead(
        self, one: Explorations, first: np.ndarray, scorer: RayScorer, rng: np.random.Generator
    ) -> np.ndarray:
        """The Jaccard index (K,) expected after each of K rays, (K, 2), and the best next one."""
        after = one.select(np.zeros(len(first) * BEYOND, int))  # K rays on each of the shapes
        after.masks[:] = np.tile(self.drawn(one, BEYOND, rng)[0], (len(first), 1, 1))
        after.cast(np.repeat(first, BEYOND, axis=0))
        second = best_rays_apart(scorer, after, SECOND)
        expected = self.expected(after, second, BEYOND, rng)  # (K · BEYOND, SECOND)
        return expected.max(axis=1).reshape(len(first), BEYOND).mean(axis=1)

    def expected(
        self, explorations: Explorations, rays: np.ndarray, shapes: int, rng: np.random.Generator
    ) -> np.ndarray:
        """Mean Jaccard index (N, K) after each of K rays, (N, K, 2), over so many drawn shapes."""
        return try_rays(explorations, rays, self.drawn(explorations, shapes, rng)).mean(axis=2)

    def drawn(self, explorations: Explorations, count: int, rng: np.random.Generator) -> np.ndarray:
        """So many shapes of the belief for each exploration, (N, count, R, R) bool."""
        return self.belief.draw(all_felt(explorations), count, rng)
