"""The rules: ten rays at a hidden shape, and a policy that casts ten at the same."""

from dataclasses import dataclass

import numpy as np

from tactile_core.exploration.policies.base import Policy
from tactile_core.exploration.world.rays import RAYS
from tactile_core.exploration.world.state import Explorations
from tactile_core.play.aim import Ray
from tactile_core.reconstruction.inference import Reconstructor


@dataclass(frozen=True)
class Step:
    """One ray and what came of it.

    touch : (row, column), None for a miss; repeated : whether that touch was held before
    reconstruction : probability of the object after the ray, (R, R) float32 in 0–1
    jaccard : Jaccard index (0–100) of that reconstruction
    """

    ray: Ray
    touch: tuple[int, int] | None
    repeated: bool
    reconstruction: np.ndarray
    jaccard: float


class Hand:
    """One who feels out a shape.

    mask : (R, R) bool, the hidden shape
    untouched : the reconstruction before the first ray, (R, R) float32
    """

    def __init__(self, mask: np.ndarray, reconstructor: Reconstructor) -> None:
        self.explorations = Explorations(mask[None], reconstructor)
        self.untouched = self.explorations.predictions[0].copy()
        self.jaccard_untouched = float(self.explorations.jaccard[0])
        self.steps: list[Step] = []

    @property
    def left(self) -> int:
        """How many rays are left."""
        return RAYS - len(self.steps)

    def reconstruction(self, rays: int) -> np.ndarray:
        """After so many rays, (R, R) float32 in 0–1."""
        return self.steps[rays - 1].reconstruction if rays else self.untouched

    def curve(self, rays: int) -> list[float]:
        """Jaccard index (0–100) before the first ray and after each of so many."""
        return [self.jaccard_untouched, *(step.jaccard for step in self.steps[:rays])]

    def cast(self, ray: Ray) -> Step:
        """Cast one ray more."""
        cast = self.explorations.cast(np.array([ray]))
        step = Step(
            ray=ray,
            touch=None if cast.missed[0] else (int(cast.touches[0, 0]), int(cast.touches[0, 1])),
            repeated=bool(cast.repeated[0]),
            reconstruction=self.explorations.predictions[0].copy(),
            jaccard=float(cast.jaccard[0]),
        )
        self.steps.append(step)
        return step


class Opponent(Hand):
    """A policy that feels out the same shape. What it casts does not depend on your rays: it may
    cast while you still aim."""

    def __init__(
        self, mask: np.ndarray, reconstructor: Reconstructor, policy: Policy, seed: int = 0
    ) -> None:
        super().__init__(mask, reconstructor)
        self.policy = policy
        self.rng = np.random.default_rng(seed)

    def think(self) -> Step:
        """Cast one ray more."""
        alpha, beta = self.policy.choose(self.explorations, self.rng, False)[0]
        return self.cast((int(alpha), int(beta)))


@dataclass(frozen=True)
class Game:
    """A hidden shape that you feel out, and perhaps a policy too.

    mask : (R, R) bool; what : the shape in words, told at the end
    """

    mask: np.ndarray
    what: str
    you: Hand
    opponent: Opponent | None = None

    @property
    def over(self) -> bool:
        """Whether your rays are all cast: then the shape is shown."""
        return self.you.left == 0


def entropy(probability: np.ndarray) -> np.ndarray:
    """Entropy of each pixel in bits, 0–1: one where it is as likely object as not."""
    p = np.clip(probability.astype(float), 1e-6, 1 - 1e-6)
    return -p * np.log2(p) - (1 - p) * np.log2(1 - p)


def uncertain_pixels(reconstruction: np.ndarray) -> float:
    """The entropies of all pixels, added up."""
    return float(entropy(reconstruction).sum())


def told(hand: Hand) -> str:
    """The last ray in a sentence."""
    step = hand.steps[-1]
    *_, before, after = hand.curve(len(hand.steps))
    if step.touch is None:
        what = "missed"
    elif step.repeated:
        what = "met a pixel that was touched before"
    else:
        what = "touched the object"
    return f"Ray {len(hand.steps)} {what}: Jaccard index {after:.1f} ({signed(after - before)})."


def signed(change: float) -> str:
    return f"{'−' if change < 0 else '+'}{abs(change):.1f}"


def outcome(game: Game) -> str:
    """How a game ended, in a sentence or two."""
    yours = game.you.steps[-1].jaccard
    ended = f"It was {game.what}. You reached {yours:.1f}"
    if game.opponent is None or game.opponent.left:
        return f"{ended}."
    theirs = game.opponent.steps[-1].jaccard
    name = game.opponent.policy.name
    verdict = "you win!" if yours > theirs else f"{name} wins." if yours < theirs else "a draw."
    return f"{ended}, {name} {theirs:.1f}: {verdict}"
