"""Many explorations in step."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_core.exploration.policies.rules import towards_middle
from tactile_core.exploration.world.rays import candidate_rays
from tactile_core.exploration.world.state import ARRAYS, Explorations
from tactile_core.reconstruction.jaccard import jaccard_index

seeds = st.integers(0, 2**32 - 1)


def some_rays(rng: np.random.Generator, count: int) -> np.ndarray:
    """Rays (count, 2) of which some hit and some miss; few differ, so that some repeat."""
    return candidate_rays(64)[rng.integers(0, 36, count) // 12 * 12, rng.integers(0, 11, count)]


@settings(deadline=None, max_examples=15)
@given(seed=seeds)
def test_counts_and_images_follow_from_the_touches(shapes, reconstructor, seed):
    rng = np.random.default_rng(seed)
    masks = shapes["test"].masks
    explorations = Explorations(masks, reconstructor)
    held: list[set] = [set() for _ in masks]
    wasted = [0] * len(masks)
    for ray in range(1, 9):
        cast = explorations.cast(some_rays(rng, len(masks)))
        for index, touch in enumerate(map(tuple, cast.touches.tolist())):
            missed, repeated = touch == (-1, -1), touch in held[index]
            assert (cast.missed[index], cast.repeated[index]) == (missed, repeated)
            wasted[index] = wasted[index] + 1 if missed or repeated else 0
            held[index] |= {touch} - {(-1, -1)}
        drawn = [set(map(tuple, np.argwhere(image).tolist())) for image in explorations.touches]
        assert drawn == held
        assert explorations.held.tolist() == [len(some) for some in held]
        assert explorations.wasted.tolist() == wasted
        assert (explorations.rays == ray).all()
    assert not (explorations.free.astype(bool) & masks).any()


@settings(deadline=None, max_examples=15)
@given(seed=seeds)
def test_predictions_are_those_of_what_was_felt_though_few_are_made_anew(
    shapes, either_reconstructor, seed
):
    rng = np.random.default_rng(seed)
    explorations = Explorations(shapes["test"].masks, either_reconstructor)
    for _ in range(5):
        before = explorations.jaccard.copy() if explorations.rays.any() else np.zeros(8)
        cast = explorations.cast(some_rays(rng, 8))
        felt = explorations.touches.astype(int)
        if either_reconstructor.free_space:
            felt[explorations.free == 1] = -1
        expected = either_reconstructor.predict(felt)
        np.testing.assert_allclose(explorations.predictions, expected, atol=1e-5)
        scores = jaccard_index(expected, explorations.masks)
        np.testing.assert_allclose(cast.jaccard, scores, atol=1e-3)
        np.testing.assert_array_equal(cast.jaccard_before, before)


@settings(deadline=None, max_examples=15)
@given(seed=seeds)
def test_what_would_be_felt_after_a_ray_is_what_is_felt_after_it(
    shapes, either_reconstructor, seed
):
    rng = np.random.default_rng(seed)
    explorations = Explorations(shapes["test"].masks, either_reconstructor)
    explorations.cast(some_rays(rng, 8))
    owners, rays, hits, touches = explorations.try_candidates()
    tried = np.arange(8) * len(rays) // 8 + rng.integers(len(rays) // 8, size=8)
    before = explorations.get_state()
    felt = explorations.felt_after(owners[tried], rays[tried], hits[tried])
    for name, value in before.items():
        np.testing.assert_array_equal(getattr(explorations, name), value)
    cast = explorations.cast(rays[tried])
    np.testing.assert_array_equal(cast.touches, hits[tried])
    np.testing.assert_array_equal(cast.missed | cast.repeated, touches[tried] < 0)
    np.testing.assert_array_equal(explorations.felt(), felt)


def test_the_u_net_is_asked_again_only_where_more_was_felt(
    shapes, either_reconstructor, monkeypatch
):
    explorations = Explorations(shapes["test"].masks, either_reconstructor)
    assert either_reconstructor.single_touches is not None  # asks when it is first looked at
    asked = []
    predict = either_reconstructor.predict
    monkeypatch.setattr(
        either_reconstructor, "predict", lambda felt: asked.append(len(felt)) or predict(felt)
    )
    first, second = candidate_rays(64)[:8, 5], candidate_rays(64)[18:26, 5]
    second = np.where(np.arange(8)[:, None] % 2, second, candidate_rays(64)[:8, 0])
    assert not explorations.cast(first).missed.any()
    cast = explorations.cast(second)
    new = ~(cast.missed | cast.repeated)
    assert 0 < new.sum() < 8
    explorations.cast(second)  # along the same ways to the same touches
    # Predictions of a first touch are looked up where nothing but touches is seen.
    assert asked == ([8, 8] if either_reconstructor.free_space else [0, new.sum()])


def test_one_pixel_more_of_free_space_is_reason_enough_to_ask_again(
    shapes, free_space_reconstructor
):
    explorations = Explorations(shapes["test"].masks[:1], free_space_reconstructor)
    ray = candidate_rays(64)[:1, 5]
    explorations.cast(ray)
    row, column = np.argwhere(explorations.free[0])[0]
    explorations.free[0, row, column] = 0
    explorations.predictions[:] = 0
    assert explorations.cast(ray).repeated.all()
    expected = free_space_reconstructor.predict(explorations.felt())
    np.testing.assert_allclose(explorations.predictions, expected, atol=1e-5)


@pytest.mark.parametrize("quarters", range(4))
@pytest.mark.parametrize("row", [10, 15, 16])
def test_a_first_touch_at_any_side_is_seen_as_the_u_net_sees_it(reconstructor, row, quarters):
    """Outside the middle half, and just inside it."""
    mask = np.zeros((1, 64, 64), bool)
    mask[0, row, 20:44] = True
    mask = np.rot90(mask, quarters, axes=(1, 2))
    explorations = Explorations(mask, reconstructor)
    cast = explorations.cast(towards_middle(np.array([np.pi + quarters * np.pi / 2]), 64))
    assert not cast.missed.any() and min(*cast.touches[0], *(63 - cast.touches[0])) == row
    expected = reconstructor.predict(explorations.touches)
    np.testing.assert_allclose(explorations.predictions, expected, atol=1e-5)


def test_each_new_touch_of_each_exploration_has_a_number_of_its_own(shapes, reconstructor):
    explorations = Explorations(shapes["test"].masks, reconstructor)
    explorations.cast(candidate_rays(64)[:8, 5])
    owners, rays, hits, numbers = explorations.try_candidates()
    assert len(owners) == len(rays) == len(hits) == 8 * candidate_rays(64)[..., 0].size
    new = numbers >= 0
    assert (hits[~new] < 0).any() and (numbers[~new] == -1).all()
    places = list(map(tuple, np.column_stack([owners, hits])[new].tolist()))
    pairs = set(zip(places, numbers[new].tolist(), strict=True))
    assert len(pairs) == len(set(places)) == len(set(numbers[new].tolist()))
    ends = [(numbers[new & (owners == one)].min(), numbers[new & (owners == one)].max())
            for one in range(8)]  # fmt: skip
    assert all(before[1] < after[0] for before, after in itertools.pairwise(ends))


def test_what_a_policy_sees_is_the_reconstruction_and_the_touches(shapes, reconstructor):
    explorations = Explorations(shapes["test"].masks, reconstructor)
    explorations.cast(candidate_rays(64)[:8, 5])
    seen = explorations.observations()
    assert (seen.shape, seen.dtype) == ((8, 2, 64, 64), np.uint8)
    np.testing.assert_array_equal(seen[:, 0], np.rint(255 * explorations.predictions))
    np.testing.assert_array_equal(seen[:, 1], 255 * explorations.touches)
    np.testing.assert_array_equal(explorations.observations(np.array([5, 2])), seen[[5, 2]])


def test_an_exploration_that_begins_anew_knows_nothing_and_leaves_the_others_alone(
    shapes, reconstructor
):
    explorations = Explorations(shapes["test"].masks, reconstructor)
    explorations.cast(candidate_rays(64)[:8, 5])
    before = explorations.get_state()
    explorations.restart(np.array([1, 6]), shapes["eval"].masks[:2])
    fresh = Explorations(shapes["eval"].masks[:2], reconstructor)
    others = [0, 2, 3, 4, 5, 7]
    for name in ARRAYS:
        now = getattr(explorations, name)
        np.testing.assert_array_equal(now[[1, 6]], getattr(fresh, name))
        np.testing.assert_array_equal(now[others], before[name][others])


def test_selected_explorations_go_on_by_themselves(shapes, reconstructor):
    explorations = Explorations(shapes["test"].masks, reconstructor)
    rays = candidate_rays(64)[:8, 5]
    explorations.cast(rays)
    chosen = explorations.select(np.array([6, 3]))
    state = explorations.get_state()
    cast = chosen.cast(rays[:2])
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(explorations, name), state[name])
    alone = explorations.cast(np.stack([rays[0]] * 8))
    assert cast.touches[0].tolist() == alone.touches[6].tolist()
    assert cast.jaccard[0] == pytest.approx(alone.jaccard[6], abs=1e-3)


@settings(deadline=None, max_examples=10)
@given(seed=seeds)
def test_an_exploration_goes_on_from_its_stored_state(shapes, reconstructor, seed):
    rng = np.random.default_rng(seed)
    first = Explorations(shapes["test"].masks, reconstructor)
    first.cast(some_rays(rng, 8))
    second = Explorations(shapes["eval"].masks, reconstructor)
    second.set_state(first.get_state())
    rays = some_rays(rng, 8)
    one, other = first.cast(rays), second.cast(rays)
    for name in vars(one):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    np.testing.assert_array_equal(first.observations(), second.observations())


def test_the_caller_s_masks_are_left_alone(shapes, reconstructor):
    masks = shapes["test"].masks.copy()
    explorations = Explorations(masks, reconstructor)
    explorations.restart(np.arange(8), np.zeros_like(masks))
    np.testing.assert_array_equal(masks, shapes["test"].masks)
