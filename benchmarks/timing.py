"""Rates that can be trusted on a machine whose speed drifts: always measured side by side."""

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np
import torch

Size = TypeVar("Size")

# Does some work and returns how much of it was done: steps, images, meshes, rays.
Work = Callable[[], float]


@dataclass(frozen=True)
class Pace:
    """How long to measure. `quick` only shows that everything runs."""

    quick: bool

    @property
    def seconds(self) -> float:
        """Seconds of each measurement, at least."""
        return 0.02 if self.quick else 1.0

    @property
    def repetitions(self) -> int:
        return 2 if self.quick else 5

    def some(self, sizes: Sequence[Size]) -> Sequence[Size]:
        """Which of the sizes of a curve to measure."""
        return sizes[:2] if self.quick else sizes


class Rates(NamedTuple):
    """Work a second, ours and the plain way: medians, and the median ratio of neighbours."""

    ours: float
    plain: float
    ratio: float


class Row(NamedTuple):
    """One line of the table.

    ratio : how many times better ours is, unless `what` says otherwise
    goal : in words; empty where none is set
    met : whether the goal is met; None where there is none, or it could not be measured
    """

    what: str
    ours: float
    plain: float
    unit: str
    ratio: float
    goal: str = ""
    met: bool | None = None


class Curve(NamedTuple):
    """Cost against size.

    values : what was measured at each of `sizes`, in `unit`
    costs : what it costs at each size, in any unit; grows as a power of the size
    linear : the power that is no surprise
    """

    what: str
    size: str
    sizes: Sequence[int]
    values: Sequence[float]
    unit: str
    costs: Sequence[float]
    linear: int = 1

    def slope(self) -> float:
        """The power of the size with which the cost grows: the slope in a log–log plot."""
        return float(np.polyfit(np.log(self.sizes), np.log(self.costs), 1)[0])

    def last_slope(self) -> float:
        """The slope over the three largest sizes, where no fixed cost hides the growth."""
        return float(np.polyfit(np.log(self.sizes[-3:]), np.log(self.costs[-3:]), 1)[0])


def alternated(ours: Work, plain: Work, pace: Pace, repetitions: int | None = None) -> Rates:
    """Both rates, measured in turn: ours, plain, ours, plain, …, after one round to warm up.

    The ratio is the median over pairs of neighbours, which a drift of the machine changes
    alike; so it need not equal the ratio of the two medians.
    """
    ours()
    plain()
    pairs = [
        (rate(ours, pace.seconds), rate(plain, pace.seconds))
        for _ in range(repetitions or pace.repetitions)
    ]
    return Rates(
        statistics.median(our for our, _ in pairs),
        statistics.median(other for _, other in pairs),
        statistics.median(our / other for our, other in pairs),
    )


def swept(works: Sequence[Work], pace: Pace) -> list[float]:
    """The rate of each work: medians over sweeps through all of them, after one to warm up."""
    for work in works:
        work()
    sweeps = [
        [rate(work, pace.seconds / 2) for work in works] for _ in range(1 if pace.quick else 3)
    ]
    return [statistics.median(rates) for rates in zip(*sweeps, strict=True)]


def rate(work: Work, seconds: float) -> float:
    """Work done per second, over at least so many seconds."""
    done = 0.0
    start = time.perf_counter()
    while True:
        done += work()
        if torch.cuda.is_available():
            torch.cuda.synchronize()
        elapsed = time.perf_counter() - start
        if elapsed >= seconds:
            return done / elapsed


def at_least(what: str, rates: Rates, unit: str, goal: float | None = None) -> Row:
    """The row of rates, higher being better, whose ratio should reach `goal`."""
    if goal is None:
        return Row(what, rates.ours, rates.plain, unit, rates.ratio)
    return Row(
        what, rates.ours, rates.plain, unit, rates.ratio, f"ratio ≥ {goal:g}", rates.ratio >= goal
    )
