"""Every candidate ray gets a value, learnt from what its touch adds."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from tactile_core.exploration.learning import replay
from tactile_core.exploration.learning.gain_learner import train_scorer
from tactile_core.exploration.learning.gains import find_gains, first_of_each
from tactile_core.exploration.learning.replay import Replay
from tactile_core.exploration.policies.references import find_reference
from tactile_core.exploration.policies.scorer import (
    ANGLES,
    OFFSETS,
    SAMPLES,
    RayScorer,
    grown,
    ray_values,
    sample_pixels,
    scorer_images,
    touch_reach,
)
from tactile_core.exploration.policies.store import ScorerPolicy
from tactile_core.exploration.world.circle import middle
from tactile_core.exploration.world.rays import candidate_rays, cast_rays, pixels_along
from tactile_core.exploration.world.state import Explorations
from tactile_core.settings import PolicySettings

CANDIDATES = ANGLES * OFFSETS
seeds = st.integers(0, 2**32 - 1)


@pytest.fixture
def explorations(shapes, reconstructor) -> Explorations:
    return after_three_rays(shapes, reconstructor)


def after_three_rays(shapes, reconstructor) -> Explorations:
    """Three test shapes, after three rays each."""
    explorations = Explorations(shapes["test"].masks[:3], reconstructor)
    for _ in range(3):
        explorations.cast(find_reference("even").choose(explorations, np.random.default_rng(0)))
    return explorations


def test_a_known_gain_is_what_casting_the_ray_adds(shapes, either_reconstructor):
    explorations = after_three_rays(shapes, either_reconstructor)
    found, known = find_gains(explorations, tries=4, rng=np.random.default_rng(0))
    assert (found != 0).any()
    candidates = candidate_rays(64).reshape(-1, 2)
    for index in range(3):
        some = np.flatnonzero(known[index])
        for candidate in [*some[:5], *some[np.argsort(-np.abs(found[index, some]))[:5]]]:
            alone = explorations.select(np.array([index]))
            alone.cast(candidates[candidate][None])
            gain = alone.jaccard[0] - explorations.jaccard[index]
            assert found[index, candidate] == pytest.approx(gain, abs=1e-2)


@settings(deadline=None, max_examples=10)
@given(seed=seeds, tries=st.integers(1, 6))
def test_so_many_touches_are_tried_and_every_ray_that_shares_one_is_known(
    shapes, reconstructor, seed, tries
):
    explorations = Explorations(shapes["test"].masks, reconstructor)
    explorations.cast(find_reference("even").choose(explorations, np.random.default_rng(seed)))
    found, known = find_gains(explorations, tries, np.random.default_rng(seed))
    candidates = candidate_rays(64).reshape(-1, 2)
    for index, mask in enumerate(explorations.masks):
        hits = cast_rays(mask[None], candidates, np.zeros(CANDIDATES, int))
        missed = hits[:, 0] < 0
        repeated = ~missed & (explorations.touches[index][tuple(hits.T)] == 1)
        wasted = missed | repeated
        assert known[index, wasted].all()
        assert not found[index, wasted].any()
        tried = {tuple(hit) for hit in hits[known[index] & ~wasted].tolist()}
        assert len(tried) == tries
        shared = np.array([tuple(hit) in tried for hit in hits.tolist()])
        np.testing.assert_array_equal(known[index], shared | wasted)
    assert not found[~known].any()


def test_where_free_space_counts_only_rays_that_were_tried_are_known(
    shapes, free_space_reconstructor
):
    explorations = after_three_rays(shapes, free_space_reconstructor)
    found, known = find_gains(explorations, 6, np.random.default_rng(0))
    touches = explorations.try_candidates()[-1].reshape(known.shape)
    for index in range(3):
        tried = touches[index, known[index]]
        assert len(tried) == 6 + 3
        assert (tried < 0).sum() == 3
        assert len(set(tried[tried >= 0])) == 6
    assert not found[~known].any()


@given(owner=st.lists(st.integers(0, 4), max_size=30).map(sorted), most=st.integers(1, 5))
def test_the_first_few_of_each_owner_are_taken_in_the_order_given(owner, most):
    owner = np.array(owner, int)
    order = np.random.default_rng(0).permutation(len(owner))
    expected = [index for one in range(5) for index in [i for i in order if owner[i] == one][:most]]
    assert first_of_each(owner, order, most).tolist() == sorted(expected)


def test_the_replay_forgets_its_oldest_states(monkeypatch):
    monkeypatch.setattr(replay, "REPLAY", 5)
    kept = Replay(48, 2)
    for number in range(8):
        kept.add(
            np.full((1, 3, 48, 48), number, np.uint8), np.array([number]),
            np.full((1, 2), number, np.float32), np.ones((1, 2), bool),
        )  # fmt: skip
    assert sorted(kept.rays) == [3, 4, 5, 6, 7]
    assert set(kept.draw(np.random.default_rng(0))) == set(range(5))
    again = Replay(48, 2)
    again.load_state(kept.state())
    for name in replay.REPLAY_ARRAYS:
        np.testing.assert_array_equal(getattr(again, name), getattr(kept, name))
    assert again.seen == 8


def test_a_young_replay_draws_only_what_was_added():
    replay = Replay(48, 2)
    replay.add(
        np.zeros((3, 3, 48, 48), np.uint8), np.arange(3), np.zeros((3, 2)), np.ones((3, 2), bool)
    )
    assert set(replay.draw(np.random.default_rng(0))) == {0, 1, 2}
    assert len(replay.state()["arrays"]["predictions"]) == 3


def test_a_scorer_learns_to_cast_rays_that_gain(shapes, reconstructor, tmp_path):
    some = PolicySettings(gain_iterations=40, gain_states=8, gain_tries=4, gain_updates=1)
    net, curve = train_scorer(
        "gain", 0, shapes["train"], reconstructor, some, key="", work=tmp_path, progress=print
    )
    assert len(curve) == 20
    assert curve["steps"].tolist() == list(range(16, 321, 16))
    assert np.isfinite(curve["loss"]).all()

    def final(policy) -> float:
        rng = np.random.default_rng(0)
        explorations = Explorations(shapes["test"].masks, reconstructor)
        for _ in range(10):
            explorations.cast(policy.choose(explorations, rng, deterministic=True))
        return float(explorations.jaccard.mean())

    assert final(ScorerPolicy("gain", 0, net)) > final(find_reference("random")) + 3


def test_a_scorer_policy_casts_the_candidate_of_highest_value(explorations):
    torch.manual_seed(0)
    net = RayScorer().eval()
    rays = ScorerPolicy("gain", 4, net).choose(explorations, np.random.default_rng(0), True)
    with torch.no_grad():
        images = torch.from_numpy(scorer_images(explorations))
        values = net(images, torch.from_numpy(explorations.rays))
    assert values.shape == (3, CANDIDATES)
    expected = candidate_rays(64).reshape(-1, 2)[values.argmax(dim=1).numpy()]
    np.testing.assert_array_equal(rays, expected)


def test_values_do_not_depend_on_how_states_are_cut_into_batches(explorations):
    net = RayScorer().eval()
    images, rays = scorer_images(explorations), explorations.rays
    many = ray_values(net, np.concatenate([images] * 50), np.concatenate([rays] * 50))
    np.testing.assert_allclose(many, np.tile(ray_values(net, images, rays), (50, 1)), atol=1e-5)


def test_a_ray_s_samples_run_along_it_from_alpha_through_the_middle_half():
    samples = sample_pixels(64).reshape(ANGLES, OFFSETS, SAMPLES)
    points = np.stack(np.divmod(samples, 64), axis=-1).astype(float) - middle(64)
    theta = 2 * np.pi * np.arange(ANGLES) / ANGLES
    inward = -np.stack([np.cos(theta), np.sin(theta)], axis=-1)
    along = np.einsum("aosp,ap->aos", points, inward)
    assert (np.diff(along, axis=-1) > -1.5).all()
    assert along[..., 0] == pytest.approx(-16, abs=3)
    assert along[..., -1] == pytest.approx(16, abs=3)


@pytest.mark.parametrize("resolution", [64, 128, 192, 256])
def test_no_ray_s_samples_step_over_a_touch(resolution):
    samples = sample_pixels(resolution).reshape(ANGLES * OFFSETS, SAMPLES)
    for sampled, passed in zip(samples[::7], pixels_along(resolution)[::7], strict=True):
        seen = np.zeros((1, resolution, resolution), np.uint8)
        seen.ravel()[sampled] = 1
        rows, columns = np.divmod(passed[passed >= 0], resolution)
        near = np.hypot(rows - middle(resolution), columns - middle(resolution)) <= resolution / 4
        assert grown(seen, touch_reach(resolution))[0, rows[near], columns[near]].all()


def test_the_same_picture_after_another_ray_has_other_values(explorations):
    """Else a ray that misses, and shows nothing new, would be cast again for ever."""
    net, images = RayScorer().eval(), scorer_images(explorations)
    values = [ray_values(net, images, np.full(3, rays)) for rays in (9, 10, 40)]
    assert not np.allclose(values[0], values[1]) and not np.allclose(values[1], values[2])


def test_twenty_steps_are_a_training_like_any_other(shapes, reconstructor, tmp_path):
    some = PolicySettings(gain_iterations=20, gain_states=2, gain_tries=1, gain_updates=1)
    _, curve = train_scorer(
        "gain", 0, shapes["train"], reconstructor, some, key="", work=tmp_path, progress=print
    )
    assert len(curve) == 20


def test_a_quarter_turn_of_the_image_turns_the_values_by_a_quarter():
    """Of the ray grid: what a ray meets decides, not where it comes from."""
    torch.manual_seed(0)
    net = RayScorer().eval()
    image = np.zeros((3, 65, 65), np.uint8)
    image[0, 20:40, 25:33] = 200
    image[0] = ndimage.gaussian_filter(image[0].astype(float), 3).astype(np.uint8)
    turned = np.rot90(image, axes=(1, 2))
    images = np.stack([image, turned])[:, :, 1:, 1:]  # turned about the circle's middle
    values = ray_values(net, np.ascontiguousarray(images), np.zeros(2, int))
    before, after = values.reshape(2, ANGLES, OFFSETS)
    shift = min(range(ANGLES), key=lambda k: np.abs(np.roll(before, k, axis=0) - after).mean())
    assert shift in (9, 27)
    spread = before.std()
    assert np.abs(np.roll(before, shift, axis=0) - after).mean() < 0.3 * spread


@pytest.mark.parametrize("reach", [1, 2])
def test_touches_grow_to_the_pixels_around_them(reach):
    images = np.zeros((2, 8, 8), np.uint8)
    images[0, 3, 4] = images[1, 0, 7] = 1
    expected = [ndimage.binary_dilation(image, np.ones((2 * reach + 1,) * 2)) for image in images]
    np.testing.assert_array_equal(grown(images, reach), expected)
    assert images.sum() == 2
