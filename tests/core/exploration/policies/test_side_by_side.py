"""One policy that chooses in several threads at a time, as rollouts by two choices let it."""

import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from stable_baselines3 import PPO
from upath import UPath

from tactile_core.exploration.policies.own import own_policy
from tactile_core.exploration.policies.store import load_policies
from tactile_core.exploration.world.interface import Interface

TIMES = 150


@pytest.fixture(params=["of the tables", "of one's own"])
def policy(request, train, unet, tmp_path):
    """A policy that PPO trained."""
    train("diff")
    if request.param == "of the tables":
        return load_policies([UPath(tmp_path) / "policy"], unet.version(), 64)[0]
    return own_policy("ppo", PPO.load(tmp_path / "policy" / "policy.zip"), Interface(), 64)


@pytest.fixture
def impatient():
    """Threads take turns after every few instructions."""
    usual = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(usual)


def test_its_rays_do_not_hang_on_what_it_chooses_elsewhere(policy, explorations, impatient):
    some = [explorations.select(np.arange(count)) for count in (4, 3)]

    def rays(which: int) -> np.ndarray:
        return policy.choose(some[which], np.random.default_rng(which), deterministic=False)

    alone = rays(0), rays(1)

    def differ(which: int) -> int:
        return sum(not np.array_equal(rays(which), alone[which]) for _ in range(TIMES))

    with ThreadPoolExecutor(2) as pool:
        assert list(pool.map(differ, (0, 1))) == [0, 0]
