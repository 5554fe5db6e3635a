"""The rays of a policy that PPO trained: those of its distribution, as Stable-Baselines3 has it."""

import numpy as np
import torch
from stable_baselines3 import PPO
from upath import UPath

from tactile_core.exploration.learning.approaches import find_approach
from tactile_core.exploration.learning.ppo import train_ppo
from tactile_core.exploration.policies.ppo import PPOPolicy
from tactile_core.exploration.policies.store import load_policies
from tactile_core.exploration.world.circle import circle_pixels, report_circle
from tactile_core.reconstruction.inference import Reconstructor
from tests.core.exploration.quick import QUICK


def test_a_stored_policy_casts_the_rays_of_the_trained_one(
    train, shapes, unet, explorations, tmp_path
):
    model, _ = train_ppo(
        find_approach("total"), 0, shapes["train"], Reconstructor(unet), QUICK,
        key="", work=tmp_path / "direct", progress=print,
    )  # fmt: skip
    train("total")
    trained = PPOPolicy("total", 0, model.policy)
    [stored] = load_policies([UPath(tmp_path) / "policy"], unet.version(), 64)
    assert (stored.name, stored.seed) == ("total", 0)
    for deterministic in (True, False):
        rays = [
            policy.choose(explorations, np.random.default_rng(0), deterministic)
            for policy in (trained, stored)
        ]
        np.testing.assert_array_equal(*rays)


def test_a_trained_policy_acts_as_stable_baselines_would(train, unet, explorations, tmp_path):
    train("diff")
    model = PPO.load(tmp_path / "policy" / "policy.zip")
    [policy] = load_policies([UPath(tmp_path) / "policy"], unet.version(), 64)
    actions, _ = model.predict(explorations.observations(), deterministic=True)
    rays = policy.choose(explorations, np.random.default_rng(0), deterministic=True)
    np.testing.assert_array_equal(circle_pixels(64)[rays], report_circle(64)[actions])


def test_stochastic_rays_are_drawn_with_the_policy_s_probabilities(
    train, unet, explorations, tmp_path
):
    settings = QUICK.model_copy(update={"entropy": 0.0, "learning_rate": 3e-3, "epochs": 8})
    train("pre_diff_miss", settings=settings)
    [policy] = load_policies([UPath(tmp_path) / "policy"], unet.version(), 64)
    one = explorations.select(np.zeros(100, int))
    rng = np.random.default_rng(0)
    draws = np.concatenate([policy.choose(one, rng, deterministic=False) for _ in range(20)])
    seen = torch.from_numpy(one.observations()[:1])
    heads = policy.net.get_distribution(seen).distribution
    for end, head in enumerate(heads):
        probabilities = head.probs[0].detach().numpy()
        pixels = circle_pixels(64)[draws[:, end]]
        counts = [(pixels == pixel).all(axis=1).sum() for pixel in report_circle(64)]
        spread = np.sqrt(2000 * probabilities * (1 - probabilities))
        assert (np.abs(counts - 2000 * probabilities) < 5 * spread + 5).all()


def test_the_random_generator_alone_decides_stochastic_rays(train, unet, explorations, tmp_path):
    train("diff")
    [policy] = load_policies([UPath(tmp_path) / "policy"], unet.version(), 64)
    rays = [
        policy.choose(explorations, np.random.default_rng(seed), deterministic=False)
        for seed in (0, 0, 1)
    ]
    np.testing.assert_array_equal(rays[0], rays[1])
    assert not np.array_equal(rays[0], rays[2])
