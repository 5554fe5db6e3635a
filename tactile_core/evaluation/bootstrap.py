"""The bootstrap behind every interval, as weights and matrix products.

All intervals are percentile bootstraps with two sources of chance:

- *models*: rotations of one model are not independent, so base models are drawn, and all
  rotations of a model travel together. They are drawn within each category, as the splits are
  stratified by category too. (A category with a single model therefore adds no width.)
- *seeds*: where a policy was trained with several seeds, its trainings are drawn as well. Policies
  of one seed may go with one U-Net, which is good or bad for all of them; so seeds travel together,
  too, among policies that have as many.

The models and seeds drawn are the same for every policy, so ratios and comparisons are paired. The
interquartile mean and the probability of improvement are those of rliable (Agarwal et al. 2021,
Deep RL at the edge of the statistical precipice), with test samples in the place of its tasks, and
but for runs of several U-Nets, of which only those with the same one are compared.

Shapes: S seeds of a policy, N test samples, B resamples. A statistic is computed for 1 + B
weightings at once: row 0 weighs every rollout once and gives the value, the others its interval.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Weights:
    """How often each sample, and each seed of a policy, counts in each of the 1 + B weightings.

    samples : (1 + B, N) float64
    seeds : policy → (1 + B, S) float64
    """

    samples: np.ndarray
    seeds: dict[str, np.ndarray]


def draw_weights(
    models: np.ndarray,
    categories: np.ndarray,
    trainings: dict[str, int],
    resamples: int,
    seed: int,
) -> Weights:
    """Draw models within categories, and each policy's seeds; the same seed gives the same draw.

    `models` and `categories` are (N,) int, those of each sample; `trainings` says how many seeds
    each policy has. A policy's draw does not depend on which others there are, and policies with
    as many seeds share it.
    """
    generator = np.random.default_rng(seed)
    samples = np.ones((1 + resamples, len(models)))
    for category in np.unique(categories):
        of_category = categories == category
        distinct, of_sample = np.unique(models[of_category], return_inverse=True)
        drawn = _drawn(generator, len(distinct), resamples)
        samples[1:, of_category] = drawn[:, of_sample]
    seeds = {}
    for policy, count in trainings.items():
        of_count = np.random.default_rng([seed, count])
        seeds[policy] = np.concatenate([np.ones((1, count)), _drawn(of_count, count, resamples)])
    return Weights(samples, seeds)


def _drawn(generator: np.random.Generator, count: int, resamples: int) -> np.ndarray:
    """How often each of `count` things comes up in as many draws with replacement: (B, count)."""
    return generator.multinomial(count, np.full(count, 1 / count), size=resamples)


def weighted_means(values: np.ndarray, samples: np.ndarray, seeds: np.ndarray) -> np.ndarray:
    """Mean of `values` (S, N, K) over seeds and samples in each weighting: (1 + B, K)."""
    s, n, k = values.shape
    totals = (samples @ values.transpose(1, 0, 2).reshape(n, s * k)).reshape(-1, s, k)
    weight = seeds.sum(axis=1) * samples.sum(axis=1)
    return np.einsum("bs,bsk->bk", seeds, totals) / weight[:, None]


def interquartile_mean(scores: np.ndarray, samples: np.ndarray, seeds: np.ndarray) -> np.ndarray:
    """Mean of the middle half of `scores` (S, N) in each weighting: (1 + B,)."""
    order = np.argsort(scores, axis=None, kind="stable")
    means = []
    for start in range(0, len(samples), 64):  # in blocks that fit the cache
        some = slice(start, start + 64)
        weight = (seeds[some, :, None] * samples[some, None, :]).reshape(-1, scores.size)[:, order]
        upto = np.cumsum(weight, axis=1)
        upto /= upto[:, -1:]
        middle = np.diff(np.clip(upto, 0.25, 0.75), axis=1, prepend=0.25)
        means.append(middle @ scores.ravel()[order] / 0.5)
    return np.concatenate(means)


def gap_closed(
    means: dict[str, np.ndarray], policy: str, tops: Sequence[str] = ("oracle",)
) -> np.ndarray:
    """(policy − random) / (top − random) in each weighting: (1 + B,); NaN where undefined.

    The top is the best of those of `tops` that there are.
    """
    there = [means[top] for top in tops if top in means]
    if "random" not in means or not there:
        return np.full_like(means[policy], np.nan)
    room = np.max(there, axis=0) - means["random"]
    return (means[policy] - means["random"]) / np.where(room > 0, room, np.nan)


def points_above(means: dict[str, np.ndarray], policy: str, bar: str) -> np.ndarray:
    """Mean of `policy` less that of `bar` in each weighting, (1 + B,): both on the same samples,
    so that hard shapes weigh on both. NaN where `bar` is absent or the policy itself."""
    if bar not in means or bar == policy:
        return np.full_like(means[policy], np.nan)
    return means[policy] - means[bar]


def probability_of_improvement(
    scores: dict[str, np.ndarray], policy: str, bar: str, weights: Weights
) -> np.ndarray:
    """How likely a run of `policy` beats a run of `bar` on a sample, ties counting half.

    `scores` holds (S, N) of each policy. Where both have several seeds, these are of U-Nets, and
    runs with the same one are compared; else every run of one with every run of the other. One
    value for each weighting, (1 + B,); NaN where `bar` is absent or the policy itself.
    """
    if bar not in scores or bar == policy:
        return np.full(len(weights.samples), np.nan)
    ours, theirs = scores[policy], scores[bar]
    if len(ours) == len(theirs) > 1:
        beats = (ours > theirs) + 0.5 * (ours == theirs)  # (S, N)
        return weighted_means(beats[..., None], weights.samples, weights.seeds[policy])[:, 0]
    ours, theirs = ours[:, None], theirs[None]
    beats = (ours > theirs) + 0.5 * (ours == theirs)  # (S, S', N)
    totals = np.einsum("bn,stn->bst", weights.samples, beats, optimize=True)
    seeds, bar_seeds = weights.seeds[policy], weights.seeds[bar]
    weight = seeds.sum(axis=1) * bar_seeds.sum(axis=1) * weights.samples.sum(axis=1)
    return np.einsum("bs,bt,bst->b", seeds, bar_seeds, totals) / weight


def interval(statistic: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Value and 95 % interval of a statistic (1 + B, …) whose row 0 is the value itself."""
    low, high = np.percentile(statistic[1:], [2.5, 97.5], axis=0)
    return statistic[0], low, high
