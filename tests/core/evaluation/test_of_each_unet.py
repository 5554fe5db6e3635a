"""Rollouts with a U-Net of each seed."""

from dataclasses import replace

import pandas as pd
import pytest
from upath import UPath

from tactile_core.errors import TactileError
from tactile_core.evaluation.of_each_unet import cast_with_each, policies_of_each
from tactile_core.evaluation.rollouts import cast_rollouts
from tactile_core.exploration.learning.approaches import find_approach
from tactile_core.exploration.learning.train import train_policy
from tactile_core.settings import RolloutSettings
from tests.core.small_run import QUICK

SOME = RolloutSettings(references=["random", "even"], choices=["drawn"], count=3, ray_limit=6)


@pytest.fixture(scope="module")
def unets(unet):
    """One, and one that is worse."""
    worse = {name: 0.7 * values for name, values in unet.weights.items()}
    return {0: unet, 1: replace(unet, weights=worse)}


@pytest.fixture(scope="module")
def places(unets, shapes, tmp_path_factory):
    """A policy trained with each."""
    folder = tmp_path_factory.mktemp("of_each")
    for seed, unet in unets.items():
        train_policy(
            find_approach("total"), seed, shapes["train"], unet, QUICK,
            directory=UPath(folder / f"total-{seed}"), work=folder / "work",
        )  # fmt: skip
    return [UPath(folder / f"total-{seed}") for seed in unets]


def test_policies_are_cast_with_the_unet_of_their_seed_and_rules_with_each(unets, places, shapes):
    policies = policies_of_each(places, unets)
    both = cast_with_each(policies, shapes["test"], unets, SOME)
    assert set(zip(both["policy"], both["seed"], strict=True)) == {
        (policy, seed) for policy in ("random", "even", "total") for seed in (0, 1)
    }
    for seed, unet in unets.items():
        alone = cast_rollouts(policies[seed], shapes["test"], unet, SOME, seed_of_references=seed)
        own = both[both["seed"] == seed].reset_index(drop=True)
        pd.testing.assert_frame_equal(own, alone)
    even = both[both["policy"] == "even"].groupby("seed")["jaccard"].mean()
    assert even[0] > even[1]  # as the U-Nets are


def test_all_policies_go_with_the_only_unet(unets, places, shapes):
    with pytest.raises(TactileError, match="total-1 was trained with another U-Net"):
        policies_of_each(places, {0: unets[0]})
    assert [one.name for one in policies_of_each(places[:1], {5: unets[0]})[5]] == ["total"]


def test_a_run_killed_with_the_second_unet_keeps_what_was_cast_with_the_first(
    unets, shapes, tmp_path
):
    none = {seed: [] for seed in unets}
    undisturbed = cast_with_each(none, shapes["test"], unets, SOME)
    work, said = tmp_path / "work", []

    def killed(message: str) -> None:
        if "seed 1, 2 of 2" in message:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        cast_with_each(none, shapes["test"], unets, SOME, None, killed, work)
    left = {file: file.stat().st_mtime_ns for file in work.iterdir()}
    assert len(left) == 2
    again = cast_with_each(none, shapes["test"], unets, SOME, None, said.append, work)
    pd.testing.assert_frame_equal(again, undisturbed)
    assert {file: file.stat().st_mtime_ns for file in left} == left
    cast_with_each(none, shapes["test"], unets, SOME, again, said.append, work)
    assert not work.exists()  # as all of it is stored by then
