"""Reference policies do what their names say."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from skimage.draw import line

from tactile_core.errors import TactileError
from tactile_core.exploration.policies.references import REFERENCES, find_reference
from tactile_core.exploration.policies.rules import even, oracle, ray_through, uncertainty
from tactile_core.exploration.world.circle import circle_pixels, middle
from tactile_core.exploration.world.rays import candidate_rays, cast_rays
from tactile_core.exploration.world.state import Explorations
from tactile_core.reconstruction.inference import Reconstructor
from tactile_core.reconstruction.jaccard import jaccard_index

DETERMINED = [name for name in REFERENCES if name != "random"]


@pytest.fixture
def explorations(shapes, reconstructor) -> Explorations:
    """One of each test shape, no ray cast."""
    return Explorations(shapes["test"].masks, reconstructor)


def rollout(name: str, explorations: Explorations, rays: int, seed: int = 0) -> np.ndarray:
    """The rays (rays, N, 2) that a reference policy casts."""
    rng = np.random.default_rng(seed)
    cast = []
    for _ in range(rays):
        cast.append(find_reference(name).choose(explorations, rng))
        explorations.cast(cast[-1])
    return np.array(cast)


@pytest.mark.parametrize("name", REFERENCES)
def test_every_reference_casts_rays_of_the_circle_and_repeats_them(name, shapes, reconstructor):
    some, same = (
        rollout(name, Explorations(shapes["test"].masks, reconstructor), 4) for _ in range(2)
    )
    assert some.shape == (4, 8, 2)
    assert some.min() >= 0
    assert some.max() < len(circle_pixels(64))
    np.testing.assert_array_equal(some, same)


@pytest.mark.parametrize("name", DETERMINED)
def test_an_exploration_is_led_alike_alone_and_among_others(name, explorations):
    rollout("random", explorations, 2)
    rollout("even", explorations, 2)
    rng = np.random.default_rng(0)
    together = find_reference(name).choose(explorations, rng)
    for index in (0, 3, 7):
        alone = find_reference(name).choose(explorations.select(np.array([index])), rng)
        np.testing.assert_array_equal(alone[0], together[index])


def test_random_rays_go_anywhere_on_the_circle(explorations):
    drawn = rollout("random", explorations, 1000)
    for end in (0, 1):
        counts = np.bincount(drawn[..., end].ravel(), minlength=176)
        assert counts == pytest.approx(8000 / 176, abs=5 * np.sqrt(8000 / 176))
    assert abs(np.corrcoef(drawn[..., 0].ravel(), drawn[..., 1].ravel())[0, 1]) < 0.05


@settings(deadline=None)
@given(
    resolution=st.sampled_from([32, 64, 128]),
    axes=st.tuples(st.floats(0.06, 0.24), st.floats(0.06, 0.24)),
    angle=st.floats(0, np.pi),
    rays=st.integers(0, 200),
)
def test_even_rays_never_miss_a_convex_shape_in_the_middle(
    reconstructor, resolution, axes, angle, rays
):
    down, right = np.indices((resolution, resolution)) - middle(resolution)
    along, across = (
        down * np.cos(angle) + right * np.sin(angle),
        right * np.cos(angle) - down * np.sin(angle),
    )
    long, short = np.array(axes) * resolution
    mask = (along / long) ** 2 + (across / short) ** 2 <= 1
    explorations = Explorations(np.zeros((1, 64, 64), bool), reconstructor)
    explorations.masks = mask[None]
    explorations.rays[:] = rays
    ray = even(explorations, np.random.default_rng(0))
    assert cast_rays(mask[None], ray)[0, 0] >= 0


def test_even_rays_share_out_the_circle(explorations):
    alphas = rollout("even", explorations, 10)[:, 0, 0]
    gaps = np.diff(np.sort(alphas), append=alphas.min() + 176)
    assert gaps.max() < 176 / 6
    assert gaps.min() > 176 / 24


@settings(deadline=None)
@given(
    target=st.tuples(st.integers(16, 47), st.integers(16, 47)),
    centroid=st.tuples(st.floats(20, 43), st.floats(20, 43)),
)
def test_a_ray_aimed_at_a_point_passes_it_and_then_the_centroid(target, centroid):
    target, centroid = np.array(target), np.array(centroid)
    alpha, beta = circle_pixels(64)[ray_through(target, centroid, 64)].tolist()
    pixels = np.stack(line(*alpha, *beta), axis=1)
    to_target, to_centroid = (
        np.linalg.norm(pixels - point, axis=1) for point in (target, centroid)
    )
    assert to_target.min() < 2
    assert to_centroid.min() < 2
    if np.linalg.norm(target - centroid) > 4:
        assert to_target.argmin() < to_centroid.argmin()


def test_coverage_aims_where_the_predicted_outline_is_farthest_from_the_touches(explorations):
    """Shapes are felt from below, so the ray comes from above."""
    from_below = np.array([[0, 88]] * 8)
    explorations.cast(from_below)
    felt = explorations.held == 1
    assert felt.sum() >= 6
    alphas = find_reference("coverage").choose(explorations, np.random.default_rng(0))[felt, 0]
    rows = circle_pixels(64)[alphas, 0]
    assert (rows < middle(64)).all()


def test_coverage_does_not_get_stuck_on_rays_that_miss_or_repeat(reconstructor):
    """A block much smaller than what the U-Net expects: most rays go past it."""
    mask = np.zeros((1, 64, 64), bool)
    mask[0, 20:23, 25:28] = True
    explorations = Explorations(mask, reconstructor)
    rays = [tuple(ray[0]) for ray in rollout("coverage", explorations, 15).tolist()]
    assert explorations.held[0] < 8
    assert len(set(rays)) >= 14


def test_where_nothing_is_predicted_coverage_casts_even_rays(unet, shapes):
    weights = {**unet.weights, "head.bias": unet.weights["head.bias"] - 50}
    blind = Reconstructor(dataclasses.replace(unet, weights=weights), "float32")
    masks = shapes["test"].masks
    np.testing.assert_array_equal(
        rollout("coverage", Explorations(masks, blind), 3),
        rollout("even", Explorations(masks, blind), 3),
    )


def test_uncertainty_never_casts_a_ray_twice(explorations):
    rays = rollout("uncertainty", explorations, 10)
    for index in range(8):
        assert len(set(map(tuple, rays[:, index].tolist()))) == 10


def test_uncertainty_takes_the_ray_of_highest_expected_entropy(explorations):
    rollout("even", explorations, 3)
    chosen = uncertainty(explorations, np.random.default_rng(0))
    for index in (0, 4):
        known = explorations.predictions[index].astype(float)
        known[explorations.free[index] == 1] = 0
        known[explorations.touches[index] == 1] = 1

        def expected_entropy(ray, known=known) -> float:
            alpha, beta = circle_pixels(64)[ray].tolist()
            score, reach = 0.0, 1.0
            for pixel in zip(*line(*alpha, *beta), strict=True):
                p = known[pixel]
                if 0 < p < 1:
                    score += reach * p * -(p * np.log(p) + (1 - p) * np.log(1 - p))
                reach *= 1 - p
            return score

        best = max(expected_entropy(ray) for ray in candidate_rays(64).reshape(-1, 2))
        assert expected_entropy(chosen[index]) == pytest.approx(best, rel=1e-3)


@pytest.mark.parametrize("rays_before", [0, 3])
def test_the_oracle_gains_what_the_best_candidate_touch_would(explorations, rays_before):
    rollout("even", explorations, rays_before)
    candidates = candidate_rays(64).reshape(-1, 2)
    best = []
    for mask, held in zip(explorations.masks, explorations.touches, strict=True):
        hits = cast_rays(mask[None], candidates, np.zeros(len(candidates), int))
        new = {tuple(hit) for hit in hits[hits[:, 0] >= 0].tolist() if not held[tuple(hit)]}
        images = np.stack([held] * len(new))
        for image, touch in zip(images, new, strict=True):
            image[touch] = 1
        best.append(jaccard_index(explorations.reconstructor.predict(images), mask).max())
    cast = explorations.cast(oracle(explorations, np.random.default_rng(0)))
    assert not (cast.missed | cast.repeated).any()
    np.testing.assert_allclose(cast.jaccard, best, atol=1e-3)


@pytest.mark.parametrize("name", ["random", "even", "coverage", "uncertainty"])
def test_no_other_reference_comes_near_the_oracle_after_one_ray(name, shapes, reconstructor):
    scores = {}
    for some in (name, "oracle"):
        explorations = Explorations(shapes["test"].masks, reconstructor)
        rollout(some, explorations, 1)
        scores[some] = explorations.jaccard
    assert (scores["oracle"] >= scores[name] - 1).all()
    assert scores["oracle"].mean() > scores[name].mean()


def test_the_oracle_goes_on_where_no_touch_is_left(reconstructor):
    mask = np.zeros((1, 64, 64), bool)
    mask[0, 31, 31] = True
    explorations = Explorations(mask, reconstructor)
    rollout("oracle", explorations, 3)
    assert explorations.held.tolist() == [1]


def test_an_unknown_reference_is_refused_with_the_known_ones():
    with pytest.raises(TactileError) as refused:
        find_reference("greedy")
    for word in ("'greedy'", *REFERENCES):
        assert word in str(refused.value)
