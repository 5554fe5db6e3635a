"""The best fixed sequence of rays."""

import numpy as np
import pytest
from upath import UPath

from tactile_core.exploration.learning.approaches import find_approach
from tactile_core.exploration.learning.sequence import best_sequence
from tactile_core.exploration.learning.train import train_policy
from tactile_core.exploration.policies.references import find_reference
from tactile_core.exploration.policies.sequence import SequencePolicy
from tactile_core.exploration.policies.store import load_policies
from tactile_core.exploration.world.rays import RAYS, candidate_rays
from tactile_core.exploration.world.state import Explorations
from tactile_core.settings import PolicySettings


@pytest.fixture(scope="module")
def found(shapes, reconstructor):
    return best_sequence("sequence", 0, shapes["train"], reconstructor, print)


def mean_after(policy, masks, reconstructor, rays: int) -> float:
    explorations, rng = Explorations(masks, reconstructor), np.random.default_rng(0)
    for _ in range(rays):
        explorations.cast(policy.choose(explorations, rng, True))
    return float(explorations.jaccard.mean())


def test_the_first_ray_is_the_best_single_one_on_average(found, shapes, reconstructor):
    masks = shapes["train"].masks
    each = [
        mean_after(SequencePolicy("one", 0, ray[None]), masks, reconstructor, 1)
        for ray in candidate_rays(64).reshape(-1, 2)
    ]
    best = mean_after(SequencePolicy("one", 0, found[0]), masks, reconstructor, 1)
    assert best == pytest.approx(max(each), abs=1e-3)


def test_it_is_better_than_random_on_shapes_that_it_was_not_chosen_on(found, shapes, reconstructor):
    masks = shapes["test"].masks
    own = mean_after(SequencePolicy("own", 0, found[0]), masks, reconstructor, RAYS)
    assert own > mean_after(find_reference("random"), masks, reconstructor, RAYS) + 3


def test_its_curve_says_what_each_ray_added(found, shapes, reconstructor):
    rays, curve = found
    assert rays.shape == (RAYS, 2)
    assert curve["steps"].tolist() == [number * len(shapes["train"]) for number in range(1, 11)]
    start = mean_after(None, shapes["train"].masks, reconstructor, 0)
    np.testing.assert_allclose(start + curve["reward"].cumsum(), curve["jaccard"], atol=1e-3)


def test_rays_follow_one_another_and_a_sweep_comes_after_them(found, shapes, reconstructor):
    rays, _ = found
    policy, even = SequencePolicy("own", 0, rays), find_reference("even")
    explorations = Explorations(shapes["test"].masks[:2], reconstructor)
    rng = np.random.default_rng(0)
    for number in range(13):
        chosen = policy.choose(explorations, rng, True)
        wanted = np.tile(rays[number], (2, 1)) if number < RAYS else even.choose(explorations, rng)
        np.testing.assert_array_equal(chosen, wanted)
        explorations.cast(chosen)


def test_a_unet_that_sees_free_space_has_a_sequence_too(shapes, free_space_reconstructor):
    some = shapes["train"].select(np.arange(4))
    rays, curve = best_sequence("sequence", 0, some, free_space_reconstructor, print)
    assert rays.shape == (RAYS, 2)
    assert curve["jaccard"].iloc[-1] > curve["jaccard"].iloc[0]


def test_it_is_stored_and_read_back(shapes, unet, tmp_path):
    directory = UPath(tmp_path / "sequence-0")
    train_policy(
        find_approach("sequence"), 0, shapes["train"], unet, PolicySettings(),
        directory=directory, work=tmp_path / "work",
    )  # fmt: skip
    [policy] = load_policies([directory], unet.version(), 64)
    assert (policy.name, policy.seed, policy.rays.shape) == ("sequence", 0, (RAYS, 2))
