"""Training policies, storing them and reading them back (report, section VI.B)."""

import dataclasses
import json

import numpy as np
import pandas as pd
import pytest
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.policies import ActorCriticCnnPolicy
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from upath import UPath

from tactile_core import progress
from tactile_core.errors import TactileError
from tactile_core.exploration.learning import gain_learner, ppo
from tactile_core.exploration.learning.approach import Approach
from tactile_core.exploration.learning.approaches import APPROACHES, find_approach
from tactile_core.exploration.learning.ppo import train_ppo
from tactile_core.exploration.learning.train import shapes_to_learn_from, train_policy
from tactile_core.exploration.policies.ppo import PPOPolicy
from tactile_core.exploration.policies.references import find_reference
from tactile_core.exploration.policies.store import load_policies
from tactile_core.exploration.world.circle import circle_pixels, report_circle
from tactile_core.exploration.world.rewards import Stage
from tactile_core.exploration.world.state import Explorations
from tactile_core.files import read_table
from tactile_core.reconstruction.inference import Reconstructor
from tactile_core.reconstruction.known_shapes import pack
from tactile_core.settings import PolicySettings

# Two updates in each stage of PPO, six iterations of learning gains.
QUICK = PolicySettings(
    steps_per_stage=512,
    environments=4,
    rays_per_rollout=64,
    batch_size=64,
    epochs=1,
    gain_iterations=6,
    gain_states=8,
    gain_tries=2,
    gain_updates=1,
)
OF_BOTH = {"policy.safetensors", "curve.parquet", "trained_on.parquet", "settings.json"}
FILES = {"ppo": OF_BOTH | {"policy.zip"}, "gains": OF_BOTH}


@pytest.fixture(autouse=True)
def talkative(monkeypatch):
    """Trainings say how far they are at every turn: here they are broken off by what they say."""
    monkeypatch.setattr(progress, "SECONDS_BETWEEN_WORDS", 0)


class PowerCutError(Exception):
    """Ends a training from outside."""


@pytest.fixture
def train(shapes, unet, tmp_path):
    """Trains a policy into `tmp_path`/name; returns the hash of its weights."""

    def run(approach, name="policy", seed=0, settings=QUICK, **options):
        return train_policy(
            find_approach(approach),
            seed,
            shapes["train"],
            unet,
            settings,
            directory=UPath(tmp_path) / name,
            work=tmp_path / "work" / name,
            **options,
        )

    return run


@pytest.fixture
def explorations(shapes, unet) -> Explorations:
    """The test shapes, after two rays each."""
    explorations = Explorations(shapes["test"].masks, Reconstructor(unet))
    for _ in range(2):
        explorations.cast(find_reference("even").choose(explorations, np.random.default_rng(0)))
    return explorations


@pytest.mark.parametrize("approach", ["diff", "gain"])
def test_a_policy_is_stored_with_its_curve_and_settings(train, unet, tmp_path, approach):
    version = train(approach, seed=3)
    stored = tmp_path / "policy"
    learner = find_approach(approach).learner
    assert {path.name for path in stored.iterdir()} == FILES[learner]
    about = json.loads((stored / "settings.json").read_text())
    assert (about["approach"], about["seed"], about["resolution"]) == (approach, 3, 64)
    assert (about["version"], about["unet"]) == (version, unet.version())
    assert about["settings"]["steps_per_stage"] == 512
    curve = read_table(stored / "curve.parquet")
    assert {"stage", "steps", "reward", "jaccard", "touches"} <= set(curve.columns)
    assert curve["steps"].is_monotonic_increasing


def test_a_training_leaves_pytorch_the_threads_it_had(train):
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        train("gain")
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)


def test_a_second_ray_scorer_has_a_recall_of_its_own(train, unet, tmp_path, monkeypatch):
    own = dataclasses.replace(find_approach("gain"), name="gain_too")
    monkeypatch.setitem(APPROACHES, "gain_too", own)
    for approach in ("gain", "gain_too"):
        train(approach, name=approach)
    names = [
        policy.name
        for approach in ("gain", "gain_too")
        for policy in load_policies([UPath(tmp_path) / approach], unet.version(), 64)
    ]
    assert names == ["gain", "recall", "gain_too", "recall_gain_too"]


@pytest.mark.parametrize("approach", ["diff", "gain"])
def test_a_finished_training_leaves_tensorboard_curves_and_no_checkpoint(
    train, tmp_path, monkeypatch, approach
):
    monkeypatch.setattr(ppo, "RAYS_PER_CHECKPOINT", 256)
    monkeypatch.setattr(gain_learner, "ITERATIONS_PER_CHECKPOINT", 2)
    train(approach)
    assert not list((tmp_path / "work").rglob("*.pt"))
    events = EventAccumulator(str(tmp_path / "work" / "policy" / "tensorboard")).Reload()
    kind = {"diff": "episode", "gain": "gain"}[approach]
    assert {f"{kind}/reward", f"{kind}/jaccard"} <= set(events.Tags()["scalars"])


def test_policies_learn_on_shapes_that_the_unet_does_not_know(shapes, unet, knowing_unet):
    train = shapes["train"]
    everything, plain = shapes_to_learn_from(train, unet)
    assert everything is train
    assert plain.version == unet.version()
    some, reconstructor = shapes_to_learn_from(train, knowing_unet)
    assert 2 * len(some) == len(train)
    rest = ~np.isin(train.model_ids, some.model_ids)
    known = dataclasses.replace(knowing_unet, known=pack(train.masks[rest]))
    assert reconstructor.version == known.version()


def test_a_single_train_model_that_the_unet_knows_is_refused(shapes, knowing_unet):
    train = shapes["train"]
    one = train.select(np.flatnonzero(train.model_ids == train.model_ids[0]))
    with pytest.raises(TactileError, match="is the only train model"):
        shapes_to_learn_from(one, knowing_unet)


def test_total_miss_trains_both_of_its_stages(train, tmp_path):
    """The first until ten touches, the second for ten rays."""
    train("total_miss")
    curve = read_table(tmp_path / "policy" / "curve.parquet")
    assert curve["stage"].tolist() == [0, 0, 1, 1]
    assert curve["steps"].tolist() == [256, 512, 768, 1024]
    assert curve["touches"].tolist()[:2] == [10, 10]
    assert (curve["rays"][:2] > 10).all()
    assert curve["rays"].tolist()[2:] == [10, 10]


def test_pre_diff_miss_rewards_add_up_to_the_jaccard_index(train, tmp_path):
    """In every episode: nothing is taken away for a miss or a repeat."""
    train("pre_diff_miss")
    curve = read_table(tmp_path / "policy" / "curve.parquet")
    np.testing.assert_allclose(curve["reward"], curve["jaccard"], atol=1e-3)


@pytest.mark.parametrize(
    ("approach", "report"),
    [("diff", 1), ("diff", 2), ("total_miss", 3), ("total_miss", 4), ("gain", 5)],
)
def test_a_training_killed_and_started_again_ends_with_the_same_weights(
    train, tmp_path, monkeypatch, approach, report
):
    """Killed before the first checkpoint, after it, and in the second stage."""
    monkeypatch.setattr(ppo, "RAYS_PER_CHECKPOINT", 256)
    monkeypatch.setattr(gain_learner, "ITERATIONS_PER_CHECKPOINT", 2)
    said = []

    def cut(message):
        said.append(message)
        if len(said) == report:
            raise PowerCutError

    whole = train(approach, "whole")
    with pytest.raises(PowerCutError):
        train(approach, "cut", progress=cut)
    resumed = []
    np.random.seed(99)  # as another process would have it
    torch.manual_seed(99)
    assert train(approach, "cut", progress=resumed.append) == whole
    assert any("resuming" in message for message in resumed) == (report > 1)
    curves = [read_table(tmp_path / name / "curve.parquet") for name in ("whole", "cut")]
    pd.testing.assert_frame_equal(*curves)


@pytest.mark.parametrize("approach", ["total", "gain"])
def test_the_seed_decides_the_weights(train, approach):
    torch.manual_seed(5)  # what happened before does not matter
    first = train(approach, "first")
    assert first == train(approach, "second")
    assert first != train(approach, "other", seed=1)


def test_approaches_differ_in_what_they_learn(train):
    assert train("diff", "one") != train("total", "other")


def test_a_checkpoint_of_other_settings_is_not_taken_up(train, monkeypatch):
    monkeypatch.setattr(ppo, "RAYS_PER_CHECKPOINT", 256)

    def cut(message):
        if "512/512" in message:
            raise PowerCutError

    with pytest.raises(PowerCutError):
        train("diff", progress=cut)
    said = []
    train("diff", settings=QUICK.model_copy(update={"entropy": 0.1}), progress=said.append)
    assert not any("resuming" in message for message in said)


def test_an_unknown_approach_is_refused_before_anything_is_trained(train, tmp_path):
    with pytest.raises(TactileError, match="approach 'dif' is unknown: choose from diff, total"):
        train("dif")
    assert not any(tmp_path.iterdir())


def test_ppo_is_the_one_of_stable_baselines_with_the_settings_given(train, tmp_path):
    settings = QUICK.model_copy(update={"entropy": 0.05, "learning_rate": 2e-4})
    train("total", settings=settings)
    model = PPO.load(tmp_path / "policy" / "policy.zip")
    assert (model.ent_coef, model.learning_rate) == (0.05, 2e-4)
    assert (model.n_steps, model.n_envs, model.batch_size, model.n_epochs) == (64, 4, 64, 1)
    assert model.policy_class is ActorCriticCnnPolicy
    assert model.num_timesteps == 512


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


@pytest.mark.parametrize("approach", ["diff", "gain"])
def test_a_policy_of_another_resolution_is_refused(train, unet, tmp_path, approach):
    train(approach)
    with pytest.raises(TactileError, match="trained at resolution 64, the U-Net is at 128"):
        load_policies([UPath(tmp_path) / "policy"], unet.version(), 128)


@pytest.mark.parametrize("approach", ["diff", "gain"])
def test_missing_and_damaged_policies_are_told_in_one_line(train, unet, tmp_path, approach):
    train(approach)
    directory = UPath(tmp_path) / "policy"
    for name in ("policy.safetensors", "settings.json"):
        whole = (directory / name).read_bytes()
        for damaged in (b"", b"{}", b"[1]", b"null", whole[: len(whole) // 2], None):
            (directory / name).unlink()
            if damaged is not None:
                (directory / name).write_bytes(damaged)
            with pytest.raises(TactileError, match="materialise policies") as refused:
                load_policies([directory], unet.version(), 64)
            assert str(directory) in str(refused.value)
            assert "\n" not in str(refused.value)
            (directory / name).write_bytes(whole)
    load_policies([directory], unet.version(), 64)


def test_a_finished_training_is_kept_and_one_that_differs_in_anything_is_not(
    train, shapes, unet, tmp_path
):
    def said(**options) -> bool:
        """Whether the policy was kept."""
        messages = []
        train("total", progress=messages.append, **options)
        return any("kept" in message for message in messages)

    assert not said()
    assert said()
    assert said(settings=QUICK.model_copy(update={"seeds": [0, 1], "gain_tries": 3}))
    assert not said(settings=QUICK.model_copy(update={"entropy": 0.02}))
    assert not said(seed=1)
    assert said(seed=1)
    (tmp_path / "policy" / "policy.safetensors").write_bytes(b"damaged")
    assert not said(seed=1)


def test_another_approach_in_the_list_leaves_the_trainings_of_others(monkeypatch):
    def bold(cast):
        return cast.jaccard**2

    def shy(cast):
        return cast.jaccard / 2

    approaches = [Approach("own", "Any.", (Stage(reward),)) for reward in (bold, shy, bold)]
    assert approaches[0].version == approaches[2].version != approaches[1].version
    described = dataclasses.replace(approaches[0], description="In other words.")
    assert described.version == approaches[0].version
    longer = dataclasses.replace(approaches[0], stages=(Stage(bold), Stage(bold, ends="touches")))
    assert longer.version != approaches[0].version
    before = find_approach("diff").version
    monkeypatch.setitem(APPROACHES, "own", approaches[0])
    assert find_approach("diff").version == before


def test_weights_under_the_settings_of_another_training_are_refused(train, unet, tmp_path):
    train("total", "one")
    train("total", "other", seed=1)
    stored = tmp_path / "other" / "policy.safetensors"
    (tmp_path / "one" / "policy.safetensors").write_bytes(stored.read_bytes())
    with pytest.raises(TactileError, match="weights and settings are of two trainings"):
        load_policies([UPath(tmp_path) / "one"], unet.version(), 64)


def test_one_flipped_bit_in_the_weights_is_found(train, unet, tmp_path):
    train("gain")
    file = tmp_path / "policy" / "policy.safetensors"
    flipped = bytearray(file.read_bytes())
    flipped[-1000] ^= 1
    file.write_bytes(flipped)
    with pytest.raises(TactileError, match="materialise policies again"):
        load_policies([UPath(tmp_path) / "policy"], unet.version(), 64)


def test_a_policy_of_another_unet_is_refused(train, tmp_path):
    train("diff")
    with pytest.raises(TactileError, match="trained with another U-Net"):
        load_policies([UPath(tmp_path) / "policy"], "another", 64)


@pytest.mark.parametrize("value", [None, [1], {"a": 1}])
def test_a_description_with_something_else_in_it_is_told_in_one_line(train, unet, tmp_path, value):
    train("diff")
    directory = UPath(tmp_path) / "policy"
    whole = json.loads((directory / "settings.json").read_bytes())
    for field in whole:
        for text in (
            {**whole, field: value},
            {name: whole[name] for name in whole if name != field},
        ):
            (directory / "settings.json").write_text(json.dumps(text))
            with pytest.raises(TactileError, match="materialise policies again") as refused:
                load_policies([directory], unet.version(), 64)
            assert "\n" not in str(refused.value) and len(str(refused.value)) < 500


@pytest.mark.parametrize(
    "altered",
    [{"approach": "gain"}, {"seed": 1}, {"settings": QUICK.model_dump() | {"discount": 0.9}}],
)
def test_a_description_that_was_altered_is_found(train, unet, tmp_path, altered):
    train("diff")
    directory = UPath(tmp_path) / "policy"
    whole = json.loads((directory / "settings.json").read_bytes())
    (directory / "settings.json").write_text(json.dumps(whole | altered))
    with pytest.raises(TactileError, match=r"settings\.json was altered"):
        load_policies([directory], unet.version(), 64)


def test_the_second_stage_meets_other_masks_than_the_first(train, monkeypatch):
    met = []

    class Watched(ppo.BatchedTactileEnv):
        def restart(self, which):
            super().restart(which)
            met.append((self.stage.ends, self.drawn[which].tolist()))

    monkeypatch.setattr(ppo, "BatchedTactileEnv", Watched)
    train("total_miss")
    first, second = (
        [mask for ends, drawn in met if ends == stage for mask in drawn][:11]
        for stage in ("touches", "rays")
    )
    assert len(first) == len(second) == 11
    assert first != second


@pytest.mark.parametrize("approach", ["diff", "gain"])
def test_curves_of_an_earlier_training_are_gone_and_those_of_a_resumed_one_stay(
    train, tmp_path, monkeypatch, approach
):
    monkeypatch.setattr(ppo, "RAYS_PER_CHECKPOINT", 256)
    monkeypatch.setattr(gain_learner, "ITERATIONS_PER_CHECKPOINT", 2)
    folder = tmp_path / "work" / "policy" / "tensorboard"

    def files() -> set[str]:
        return {path.name for path in folder.iterdir()}

    train(approach)
    first = files()

    def cut(message):
        if "5/6" in message or "512/512" in message:
            raise PowerCutError

    with pytest.raises(PowerCutError):
        train(approach, seed=1, progress=cut)
    interrupted = files()
    assert not first & interrupted
    train(approach, seed=1)
    assert interrupted < files()
