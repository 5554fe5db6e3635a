"""Every ray of every policy is cast once, and both evaluations (report, section VII) read them."""

import dataclasses

import numpy as np
import pandas as pd
import pytest
from upath import UPath

from tactile_core.errors import TactileError
from tactile_core.evaluation import casting
from tactile_core.evaluation.casting import Casting, cast_one, policy_rng
from tactile_core.evaluation.readings import per_grasp_reading, per_step_reading
from tactile_core.evaluation.replay import replayed
from tactile_core.evaluation.rollouts import cast_rollouts
from tactile_core.exploration.learning.approaches import find_approach
from tactile_core.exploration.learning.train import train_policy
from tactile_core.exploration.policies.ppo import PPOPolicy
from tactile_core.exploration.policies.references import REFERENCES, find_reference
from tactile_core.exploration.policies.sequence import SequencePolicy
from tactile_core.exploration.policies.store import Policy, load_policies
from tactile_core.exploration.world.circle import circle_pixels
from tactile_core.exploration.world.state import Explorations
from tactile_core.parquet import read_table, table_hash, write_table
from tactile_core.reconstruction.inference import Reconstructor
from tactile_core.settings import EvaluationSettings, PolicySettings, RolloutSettings

SETTINGS = RolloutSettings(count=4, ray_limit=12)
DRAWN = EvaluationSettings(count=4)
LIKELIEST = EvaluationSettings(count=4, choice="likeliest")
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
def rollouts(trained, shapes, unet) -> pd.DataFrame:
    return cast_rollouts(trained, shapes["test"], unet, SETTINGS, workers=2)


@pytest.fixture(scope="module")
def steps(rollouts) -> pd.DataFrame:
    return per_step_reading(rollouts, LIKELIEST)


@pytest.fixture(scope="module")
def grasps(rollouts) -> pd.DataFrame:
    return per_grasp_reading(rollouts, DRAWN)


@pytest.fixture(scope="module")
def reconstructor(unet) -> Reconstructor:
    """As rollouts are made with."""
    return Reconstructor(unet)


def test_a_row_says_what_a_ray_did(rollouts, shapes):
    columns = ["ray", "alpha", "beta", "row", "column", "missed", "repeated", "touches", "jaccard"]
    who = ["policy", "seed", "choice", "sample_id", "model_id", "category"]
    assert list(rollouts.columns) == [*who, *columns, "key"]
    assert set(rollouts.loc[rollouts["policy"] == "total", "choice"]) == {"likeliest", "drawn"}
    assert set(rollouts.loc[rollouts["policy"] != "total", "choice"]) == {"rule"}
    test = shapes["test"]
    mask_of = dict(zip(test.sample_ids, test.masks, strict=True))
    assert ((rollouts["row"] == -1) == rollouts["missed"]).all()
    hits = rollouts[~rollouts["missed"]]
    assert all(
        mask_of[sample][row, column]
        for sample, row, column in zip(hits["sample_id"], hits["row"], hits["column"], strict=True)
    )


def test_a_rollout_ends_with_enough_rays_and_touches_or_at_the_limit(rollouts):
    runs = rollouts.groupby(["policy", "seed", "choice", "sample_id"])
    assert (runs["ray"].max() == runs.size()).all()
    last, before = runs.nth(-1), runs.nth(-2)
    enough = (last["ray"] >= SETTINGS.count) & (last["touches"] >= SETTINGS.count)
    assert (enough | (last["ray"] == SETTINGS.ray_limit)).all()
    assert ((before["ray"] < SETTINGS.count) | (before["touches"] < SETTINGS.count)).all()
    assert (last["ray"] < SETTINGS.ray_limit).any()


def test_the_rollouts_are_the_same_however_many_are_cast_at_a_time(rollouts, trained, shapes, unet):
    alone = cast_rollouts(trained, shapes["test"], unet, SETTINGS, workers=1)
    pd.testing.assert_frame_equal(alone, rollouts)


def test_a_policy_that_did_not_change_keeps_its_rays_and_a_new_one_casts_its_own(
    trained, shapes, unet, tmp_path
):
    some = SETTINGS.model_copy(update={"references": ["even"]})
    said: list[str] = []
    first = cast_rollouts(trained[:1], shapes["test"], unet, some)
    write_table(first, UPath(tmp_path) / "rollouts.parquet")
    marked = read_table(UPath(tmp_path) / "rollouts.parquet").assign(jaccard=7.0)
    both = cast_rollouts(trained, shapes["test"], unet, some, marked, said.append)
    mine = (both["policy"] == "total") & (both["seed"] == 1)
    assert (both.loc[~mine, "jaccard"] == 7.0).all()
    assert not (both.loc[mine, "jaccard"] == 7.0).any()
    assert "rollouts: 3 of 5 are kept as they are" in said


@pytest.mark.parametrize("what", ["seed", "shapes", "unet", "weights"])
def test_rays_are_cast_anew_where_what_they_depend_on_is_another(what, trained, shapes, unet):
    some = SETTINGS.model_copy(update={"references": ["random"], "count": 2})
    test, policies = shapes["test"], trained[:1]
    before = cast_rollouts(policies, test, unet, some)
    if what == "seed":
        some = some.model_copy(update={"seed": 1})
    if what == "shapes":
        test = test.select(np.arange(len(test))[::-1])
    if what == "unet":
        weights = {name: value * 2 for name, value in unet.weights.items()}
        unet = dataclasses.replace(unet, weights=weights)
    if what == "weights":
        policies = [PPOPolicy("total", 0, trained[1].net)]
    after = cast_rollouts(policies, test, unet, some, before)
    same = set(after["key"]) & set(before["key"])
    of_random = set(before.loc[before["policy"] == "random", "key"])
    assert same == (of_random if what == "weights" else set())


def test_what_was_kept_has_the_hash_of_what_is_cast_anew(trained, shapes, unet, tmp_path):
    some = SETTINGS.model_copy(update={"references": ["even", "random"]})
    anew = cast_rollouts(trained, shapes["test"], unet, some)
    write_table(anew, UPath(tmp_path) / "rollouts.parquet")
    previous = read_table(UPath(tmp_path) / "rollouts.parquet")
    without = previous[previous["policy"] != "even"]
    kept = cast_rollouts(trained, shapes["test"], unet, some, previous)
    mixed = cast_rollouts(trained, shapes["test"], unet, some, without)
    assert table_hash(kept) == table_hash(anew) == table_hash(mixed)


class KilledError(Exception):
    """Where a run is broken off."""


def test_what_a_killed_run_has_cast_is_kept(shapes, unet, tmp_path, monkeypatch):
    """And gives the table that an undisturbed run gives."""
    monkeypatch.setattr(casting, "SAMPLES_AT_A_TIME", 3)  # of 8
    some = SETTINGS.model_copy(update={"references": ["random", "even"]})
    undisturbed = cast_rollouts([], shapes["test"], unet, some, workers=1)

    def killed(message: str) -> None:
        if "random" in message:
            raise KilledError

    with pytest.raises(KilledError):
        cast_rollouts([], shapes["test"], unet, some, None, killed, workers=1, work=tmp_path)
    left = sorted(tmp_path.glob("*.parquet"))
    assert len(left) >= 3
    assert set(pd.concat(map(read_table, left))["policy"]) >= {"random"}
    again = cast_rollouts([], shapes["test"], unet, some, workers=1, work=tmp_path)
    pd.testing.assert_frame_equal(again, undisturbed)


def test_what_a_killed_run_has_left_is_not_cast_again(shapes, unet, reconstructor, tmp_path):
    some = SETTINGS.model_copy(update={"references": ["even"]})
    first = cast_rollouts([], shapes["test"], unet, some)
    even = Casting(find_reference("even"), "rule", first["key"][0])
    cast_one(even, shapes["test"], reconstructor, some, tmp_path)
    (left,) = tmp_path.iterdir()
    write_table(read_table(left).assign(jaccard=-1.0), left)
    assert (cast_rollouts([], shapes["test"], unet, some, work=tmp_path)["jaccard"] == -1).all()


def test_samples_that_are_cast_apart_draw_numbers_of_their_own(shapes, unet, monkeypatch):
    monkeypatch.setattr(casting, "SAMPLES_AT_A_TIME", 4)
    some = SETTINGS.model_copy(update={"references": ["random"]})
    rays = cast_rollouts([], shapes["test"], unet, some).query("ray == 1")[["alpha", "beta"]]
    assert not (rays[:4].to_numpy() == rays[4:].to_numpy()).all()


def test_choices_and_lengths_that_were_not_cast_are_refused(rollouts):
    only = rollouts[rollouts["choice"] != "likeliest"]
    assert len(per_step_reading(only, DRAWN))
    with pytest.raises(TactileError, match="hold no 'likeliest' rays of 'total'"):
        per_step_reading(only, LIKELIEST)
    for reading in (per_step_reading, per_grasp_reading):
        with pytest.raises(TactileError, match="end before 5 rays or touches"):
            reading(rollouts, EvaluationSettings(count=5))


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


def test_adding_a_policy_leaves_the_rows_of_the_others_as_they_were(
    rollouts, shapes, unet, trained
):
    few = SETTINGS.model_copy(update={"references": ["uncertainty", "random"]})
    alone = cast_rollouts(trained[1:], shapes["test"], unet, few)
    for policy in (("uncertainty", 0), ("random", 0), ("total", 1)):
        pd.testing.assert_frame_equal(rows_of(alone, *policy), rows_of(rollouts, *policy))


def test_the_seed_decides_what_random_policies_do(shapes, unet):
    def cast(seed: int) -> pd.DataFrame:
        some = SETTINGS.model_copy(update={"references": ["random"], "seed": seed})
        return cast_rollouts([], shapes["test"], unet, some).drop(columns="key")

    first, again, other = cast(3), cast(3), cast(4)
    pd.testing.assert_frame_equal(first, again)
    assert not first.equals(other)


def test_each_training_seed_and_policy_draws_numbers_of_its_own(trained):
    policies = [*trained, find_reference("random"), find_reference("even")]
    drawn = [policy_rng(policy, 0).random() for policy in policies]
    assert len(set(drawn)) == 4
    assert policy_rng(trained[0], 1).random() not in drawn


def test_a_reading_takes_the_rays_of_its_choice_and_of_every_rule(rollouts, steps):
    drawn = per_step_reading(rollouts, DRAWN)
    pd.testing.assert_frame_equal(rows_of(drawn, "even"), rows_of(steps, "even"))
    assert not rows_of(drawn, "total").equals(rows_of(steps, "total"))


@pytest.mark.parametrize("name", ["even", "random", "oracle", "total"])
def test_a_replayed_rollout_is_the_one_in_the_table(name, shapes, reconstructor, rollouts):
    test = shapes["test"]
    rows = rows_of(rollouts, name)
    rows = rows[(rows["sample_id"] == test.sample_ids[5]) & (rows["choice"] != "likeliest")]
    rollout = replayed(rows, test, 5, reconstructor)
    assert rollout.policy == name
    np.testing.assert_allclose(rollout.jaccard, rows["jaccard"], atol=0.5)
    np.testing.assert_array_equal(rollout.touches, rows[["row", "column"]])
    np.testing.assert_array_equal(rollout.mask, test.masks[5])
    circle = set(map(tuple, circle_pixels(64).tolist()))
    assert rollout.rays.shape == (len(rows), 4)
    assert set(map(tuple, rollout.rays.reshape(-1, 2).tolist())) <= circle
    held = np.zeros((1, 64, 64), np.uint8)
    for step, (row, column) in enumerate(rollout.touches):
        if row >= 0:
            held[0, row, column] = 1
            predicted = reconstructor.predict(held)[0]
            np.testing.assert_allclose(rollout.predictions[step], predicted, atol=0.02)


def test_two_policies_of_one_name_and_seed_are_refused_before_any_is_rolled_out(
    trained, shapes, unet
):
    said: list[str] = []
    twice = [trained[0], trained[0]]
    with pytest.raises(TactileError, match="two policies are called 'total' with seed 0"):
        cast_rollouts(twice, shapes["test"], unet, SETTINGS, progress=said.append)
    assert not said


def test_an_error_in_one_rollout_is_raised(shapes, unet):
    broken = SequencePolicy("broken", 0, np.full((1, 2), 10**6))
    with pytest.raises(IndexError):
        cast_rollouts([broken], shapes["test"], unet, SETTINGS, workers=2)
