"""The report's two evaluations (section VII)."""

import numpy as np
import pandas as pd
import pytest
from upath import UPath

from tactile_core.errors import TactileError
from tactile_core.evaluation.protocols import (
    evaluate_per_grasp,
    evaluate_per_step,
    policy_rng,
    record_rollout,
)
from tactile_core.exploration.learning.approaches import find_approach
from tactile_core.exploration.learning.train import train_policy
from tactile_core.exploration.policies.references import REFERENCES, find_reference
from tactile_core.exploration.policies.store import Policy, load_policies
from tactile_core.exploration.world.circle import circle_pixels
from tactile_core.exploration.world.state import Explorations
from tactile_core.settings import EvaluationSettings, PolicySettings

SETTINGS = EvaluationSettings(count=4, ray_limit=12)
WHO = ["policy", "seed", "sample_id", "model_id", "category"]


@pytest.fixture(scope="module")
def trained(shapes, unet, tmp_path_factory) -> list[Policy]:
    """Two seeds of PPO, barely trained."""
    folder = tmp_path_factory.mktemp("policies")
    quick = PolicySettings(
        steps_per_stage=128, environments=4, rays_per_rollout=32, batch_size=32, epochs=1
    )
    directories = [UPath(folder) / f"total-{seed}" for seed in (0, 1)]
    for seed, directory in enumerate(directories):
        train_policy(
            find_approach("total"), seed, shapes["train"], unet, quick,
            directory=directory, work=folder / "work" / str(seed),
        )  # fmt: skip
    return load_policies(directories, unet.version(), 64)


@pytest.fixture(scope="module")
def steps(trained, shapes, reconstructor) -> pd.DataFrame:
    return evaluate_per_step(trained, shapes["test"], reconstructor, SETTINGS)


@pytest.fixture(scope="module")
def grasps(trained, shapes, reconstructor) -> pd.DataFrame:
    return evaluate_per_grasp(trained, shapes["test"], reconstructor, SETTINGS)


def rows_of(table: pd.DataFrame, policy: str, seed: int = 0) -> pd.DataFrame:
    rows = table[(table["policy"] == policy) & (table["seed"] == seed)]
    return rows.reset_index(drop=True)


def test_every_policy_has_a_row_for_each_sample_and_step(steps, shapes):
    assert list(steps.columns) == [*WHO, "step", "jaccard", "touches", "missed", "repeated"]
    policies = [(name, 0) for name in REFERENCES] + [("total", 0), ("total", 1)]
    assert list(steps.groupby(["policy", "seed"], sort=False).groups) == policies
    test = shapes["test"]
    for policy in policies:
        rows = rows_of(steps, *policy)
        assert rows["step"].tolist() == np.repeat([1, 2, 3, 4], 8).tolist()
        assert rows["sample_id"].tolist() == 4 * test.sample_ids.tolist()
        assert rows["model_id"].tolist() == 4 * test.model_ids.tolist()
        assert rows["category"].tolist() == 4 * test.categories.tolist()


def test_every_ray_adds_a_touch_unless_it_misses_or_repeats(steps):
    assert not (steps["missed"] & steps["repeated"]).any()
    gained = ~(steps["missed"] | steps["repeated"])
    counted = gained.groupby([steps["policy"], steps["seed"], steps["sample_id"]]).cumsum()
    assert (steps["touches"] == counted).all()
    assert steps["missed"].any()
    assert gained.any()


def test_a_ray_that_adds_no_touch_leaves_the_jaccard_index_as_it_was(steps):
    before = steps.groupby(["policy", "seed", "sample_id"])["jaccard"].shift()
    same = (steps["missed"] | steps["repeated"]) & (steps["step"] > 1)
    assert same.any()
    assert (steps["jaccard"][same] == before[same]).all()


def test_rays_to_each_touch_are_counted_as_in_a_plain_rollout(grasps, shapes, reconstructor):
    """Without ever setting finished explorations aside."""
    test = shapes["test"]
    for name in ("even", "oracle", "uncertainty"):
        rows = rows_of(grasps, name).set_index(["sample_id", "grasp"])
        explorations = Explorations(test.masks, reconstructor)
        rng = np.random.default_rng(0)
        for ray in range(1, SETTINGS.ray_limit + 1):
            before = explorations.held.copy()
            explorations.cast(find_reference(name).choose(explorations, rng))
            for index in np.flatnonzero(explorations.held > before):
                grasp = explorations.held[index]
                if grasp <= SETTINGS.count:
                    row = rows.loc[(test.sample_ids[index], grasp)]
                    assert row["rays"] == ray
                    assert row["jaccard"] == pytest.approx(explorations.jaccard[index], abs=1e-3)


def test_a_touch_that_is_not_reached_is_a_row_without_jaccard_index(grasps):
    assert list(grasps.columns) == [*WHO, "grasp", "jaccard", "rays"]
    assert len(grasps) == 7 * 8 * 4
    missing = grasps["jaccard"].isna()
    assert missing[grasps["policy"] == "random"].any()
    assert not missing[grasps["policy"] == "oracle"].any()
    assert (grasps["rays"][missing] == SETTINGS.ray_limit).all()
    assert grasps["rays"].between(grasps["grasp"], SETTINGS.ray_limit).all()
    runs = grasps.sort_values("grasp").groupby(["policy", "seed", "sample_id"])
    assert runs["rays"].is_monotonic_increasing.all()
    first_missing = runs["jaccard"].apply(lambda jaccard: jaccard.isna().is_monotonic_increasing)
    assert first_missing.all()


@pytest.mark.parametrize("evaluate", [evaluate_per_step, evaluate_per_grasp])
def test_adding_a_policy_leaves_the_rows_of_the_others_as_they_were(
    steps, grasps, shapes, reconstructor, trained, evaluate
):
    few = SETTINGS.model_copy(update={"references": ["uncertainty", "random"]})
    alone = evaluate(trained[1:], shapes["test"], reconstructor, few)
    together = steps if evaluate is evaluate_per_step else grasps
    for policy in (("uncertainty", 0), ("random", 0), ("total", 1)):
        pd.testing.assert_frame_equal(rows_of(alone, *policy), rows_of(together, *policy))


def test_the_seed_decides_what_random_policies_do(shapes, reconstructor):
    def evaluate(seed: int) -> pd.DataFrame:
        some = SETTINGS.model_copy(update={"references": ["random"], "seed": seed})
        return evaluate_per_step([], shapes["test"], reconstructor, some)

    first, again, other = evaluate(3), evaluate(3), evaluate(4)
    pd.testing.assert_frame_equal(first, again)
    assert not first.equals(other)


def test_each_training_seed_and_policy_draws_numbers_of_its_own(trained):
    policies = [*trained, find_reference("random"), find_reference("even")]
    drawn = [policy_rng(policy, 0).random() for policy in policies]
    assert len(set(drawn)) == 4
    assert policy_rng(trained[0], 1).random() not in drawn


def test_trained_policies_are_deterministic_only_where_that_is_set(
    trained, shapes, reconstructor, steps
):
    free = SETTINGS.model_copy(update={"references": ["even"], "deterministic": False})
    drawn = evaluate_per_step(trained, shapes["test"], reconstructor, free)
    pd.testing.assert_frame_equal(rows_of(drawn, "even"), rows_of(steps, "even"))
    assert not rows_of(drawn, "total").equals(rows_of(steps, "total"))


@pytest.mark.parametrize("name", ["even", "coverage", "uncertainty", "oracle"])
def test_a_recorded_rollout_is_the_one_in_the_table(name, shapes, reconstructor, steps):
    test = shapes["test"]
    rollout = record_rollout(find_reference(name), test, 5, reconstructor, SETTINGS)
    rows = rows_of(steps, name)
    rows = rows[rows["sample_id"] == test.sample_ids[5]]
    np.testing.assert_allclose(rollout.jaccard, rows["jaccard"], atol=1e-3)
    assert ((rollout.touches[:, 0] == -1) == rows["missed"]).all()


def test_a_recorded_rollout_holds_what_is_drawn(shapes, reconstructor):
    test = shapes["test"]
    rollout = record_rollout(find_reference("even"), test, 2, reconstructor, SETTINGS)
    assert rollout.policy == "even"
    np.testing.assert_array_equal(rollout.mask, test.masks[2])
    circle = set(map(tuple, circle_pixels(64).tolist()))
    assert rollout.rays.shape == (4, 4)
    assert set(map(tuple, rollout.rays.reshape(-1, 2).tolist())) <= circle
    held = np.zeros((1, 64, 64), np.uint8)
    for step, (row, column) in enumerate(rollout.touches):
        assert test.masks[2][row, column]
        held[0, row, column] = 1
        np.testing.assert_allclose(
            rollout.predictions[step], reconstructor.predict(held)[0], atol=1e-5
        )


def test_two_policies_of_one_name_and_seed_are_refused_before_any_is_rolled_out(
    trained, shapes, reconstructor
):
    said = []
    with pytest.raises(TactileError, match="two policies are called 'total' with seed 0"):
        evaluate_per_step(
            [trained[0], trained[0]], shapes["test"], reconstructor, SETTINGS, said.append
        )
    assert not said


def test_an_unknown_reference_is_refused(shapes, reconstructor):
    odd = SETTINGS.model_copy(update={"references": ["greedy"]})
    with pytest.raises(TactileError, match="'greedy' is unknown: choose from random, even"):
        evaluate_per_step([], shapes["test"], reconstructor, odd)
