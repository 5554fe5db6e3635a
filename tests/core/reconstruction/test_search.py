"""The hyperparameter search, on a Ray cluster of its own (report, section V and Table I)."""

import random

import numpy as np
import pandas as pd
import pytest
import ray
from upath import UPath

from tactile_core.errors import TactileError
from tactile_core.reconstruction import search as search_module
from tactile_core.reconstruction.batches import TouchSource, draw_touch_sets
from tactile_core.reconstruction.epoch import PARTS, begin_training, train_epoch
from tactile_core.reconstruction.hyperparameters import with_best_trial
from tactile_core.reconstruction.search import (
    resources_per_trial,
    search_unet,
    seeded,
)
from tactile_core.reconstruction.training import evaluate
from tactile_core.reconstruction.trial import trial_key
from tactile_core.settings import SearchSettings, UNetSettings
from tests.object_store import BUCKET, object_store
from tests.ray_nodes import one_node

# HpBandSter uses names that ConfigSpace is about to drop.
pytestmark = pytest.mark.filterwarnings("ignore:Please use:DeprecationWarning")

# Of four trials, HyperBand pauses all after one epoch, resumes two, and one goes to the end.
SETTINGS = SearchSettings(
    trials=4,
    epochs=4,
    reduction_factor=2,
    learning_rate=[1e-3, 1e-2],
    batch_sizes=[6, 12],
    depths=[1, 2],
    channels=[2, 4],
)


@pytest.fixture(scope="module")
def cluster(ray_token):
    """A running cluster of one processor, named by RAY_ADDRESS, that asks for a token."""
    with one_node(1, ray_token):
        yield ray_token


@pytest.fixture(scope="module")
def search(cluster, small_shapes):
    """Searches on the small shapes."""

    def run(work, settings=SETTINGS, progress=lambda message: None, previous=None) -> pd.DataFrame:
        return search_unet(
            small_shapes["train"], small_shapes["eval"], settings,
            previous=previous, work=work, token=cluster, progress=progress,
        )  # fmt: skip

    return run


@pytest.fixture(scope="module")
def table(search, tmp_path_factory) -> pd.DataFrame:
    return search(tmp_path_factory.mktemp("search") / "work")


def test_every_trial_is_a_row_and_the_best_comes_first(table):
    assert list(table.columns) == [
        "trial", "learning_rate", "batch_size", "depth", "channels", "epochs", "loss", "jaccard",
        "key",
    ]  # fmt: skip
    assert table["trial"].tolist() == [1, 2, 3, 4]
    assert table["loss"].is_monotonic_increasing
    assert table["learning_rate"].between(1e-3, 1e-2).all()
    assert table["batch_size"].isin([6, 12]).all()
    assert table["depth"].isin([1, 2]).all()
    assert table["channels"].isin([2, 4]).all()
    assert table["jaccard"].between(0, 100).all()


def test_a_finished_search_is_kept_as_long_as_its_settings_are(table, search, tmp_path):
    assert search(tmp_path, previous=table) is table
    other = SETTINGS.model_copy(update={"seed": 1, "trials": 1, "epochs": 1})
    again = search(tmp_path, other, previous=table)
    assert set(again["key"]).isdisjoint(table["key"]) and len(again) == 1


def test_hyperband_gives_its_epochs_to_the_promising_trials(table):
    assert sorted(table["epochs"]) == [1, 1, 2, 4]
    assert table["epochs"].iloc[0] == 4


def test_a_trial_that_was_paused_ends_as_one_that_was_not(table, small_shapes):
    masks = small_shapes["eval"].masks
    touch_sets = draw_touch_sets(small_shapes["eval"], np.random.default_rng(SETTINGS.seed))
    for row in table.itertuples():
        training = begin_training(row.depth, row.channels, row.learning_rate, SETTINGS.seed)
        for _ in range(row.epochs):
            train_epoch(training, small_shapes["train"], row.batch_size, parts=PARTS)
            # Normalisation follows what the net has seen, so evaluate as the search does.
            loss, jaccard = evaluate(training.net, touch_sets, masks, training.device)
        assert row.loss == pytest.approx(loss, rel=1e-5)
        assert row.jaccard == pytest.approx(jaccard.mean(), abs=0.1)


class PowerCutError(Exception):
    """Ends a search from outside."""


def test_a_search_that_was_killed_repeats_no_epoch_and_ends_the_same(search, table, tmp_path):
    """The kept files tell: those of trials that were done are not written again."""
    work = tmp_path / "work"

    def cut(message):
        if "trial 4/4 epoch 1" in message:
            raise PowerCutError

    with pytest.raises(Exception, match="PowerCutError"):
        search(work, progress=cut)
    done = {path.name: path.stat().st_mtime_ns for path in work.glob("epochs/*.pt")}
    assert len(done) == 4

    written = {}

    def watch(message):
        for path in work.glob("epochs/*.pt"):
            written.setdefault(path.name, set()).add(path.stat().st_mtime_ns)

    assert search(work, progress=watch).equals(table)
    assert set(written) == set(done)
    assert all(done[name] in times for name, times in written.items())
    untouched = [name for name, times in written.items() if times == {done[name]}]
    assert len(untouched) == 2  # the trials that end after one epoch

    said = []  # it is kept until it has been stored
    assert search(work, progress=said.append).equals(table)
    assert said == ["U-Net search: kept, as nothing that it depends on has changed"]
    assert [place.name for place in work.iterdir()] == ["finished.parquet"]
    assert search(work, previous=table) is table
    assert not work.exists()


def test_trials_may_be_kept_in_an_object_store(search, table, monkeypatch):
    """As on a cluster, whose nodes share nothing else."""
    with object_store(monkeypatch) as store:
        access = {
            "key": store.variables["AWS_ACCESS_KEY_ID"],
            "secret": store.variables["AWS_SECRET_ACCESS_KEY"],
            "endpoint_url": store.variables["AWS_ENDPOINT_URL"],
        }
        seen = set()
        work = UPath(f"s3://{BUCKET}/work", **access)
        assert search(work, progress=lambda message: seen.update(store.names())).equals(table)
        assert sum(name.startswith("work/epochs/") for name in seen) == SETTINGS.trials
        assert store.names() == ["work/finished.parquet"]


def test_a_trial_that_fails_is_told_and_left_out(search, tmp_path):
    """Depth 6 cannot halve the 24-pixel window of resolution 48 five times."""
    said = []
    some = SETTINGS.model_copy(update={"epochs": 1, "trials": 2, "depths": [1, 6], "seed": 1})
    table = search(tmp_path / "work", some, said.append)
    assert sum("failed and is left out" in message for message in said) == 1
    assert table["depth"].tolist() == [1]


def test_a_trial_that_fails_after_a_good_report_cannot_win(search, tmp_path, monkeypatch):
    def explodes(config, train, eval_shapes, settings, touches, work):
        from ray import tune

        deep = config["depth"] == 2
        tune.report({"loss": 0.01 if deep else 0.5, "jaccard": 99.0 if deep else 50.0})
        if deep:
            raise RuntimeError("the loss is no longer finite")

    monkeypatch.setattr(search_module, "run_trial", explodes)
    some = SETTINGS.model_copy(update={"trials": 2, "reduction_factor": 4, "seed": 1})
    table = search(tmp_path / "work", some)
    assert len(table) == 1
    assert set(table["depth"]) == {1}
    with pytest.raises(TactileError, match="every trial of the U-Net search failed"):
        search(tmp_path / "work", some.model_copy(update={"depths": [2], "trials": 1}))


def test_a_trial_gets_no_more_than_one_node_has(monkeypatch):
    def nodes(*resources):
        monkeypatch.setattr(
            ray, "nodes", lambda: [{"Alive": True, "Resources": some} for some in resources]
        )

    nodes({"CPU": 8.0}, {"CPU": 8.0})
    assert resources_per_trial(1) == {"cpu": 8}
    assert resources_per_trial(4) == {"cpu": 4}
    assert resources_per_trial(40) == {"cpu": 1}
    nodes({"CPU": 16.0, "GPU": 3.0})
    assert resources_per_trial(2) == {"cpu": 8, "gpu": 1}
    assert resources_per_trial(6) == {"cpu": 2, "gpu": 0.5}


def test_without_a_cluster_a_local_ray_starts_and_is_shut_down_whatever_happens(
    small_shapes, ray_token, tmp_path, monkeypatch
):
    """Here every trial fails; the reason is told in one line."""
    monkeypatch.delenv("RAY_ADDRESS", raising=False)
    deep = SETTINGS.model_copy(update={"epochs": 1, "trials": 1, "depths": [6]})
    started = []
    with pytest.raises(TactileError, match="choose a smaller depth") as refused:
        search_unet(
            small_shapes["train"], small_shapes["eval"], deep, work=tmp_path / "work",
            token=ray_token,
            progress=lambda message: started.append(ray.is_initialized()),
        )  # fmt: skip
    assert "\n" not in str(refused.value)
    assert started[-1]
    assert not ray.is_initialized()


def test_seeding_the_search_leaves_the_global_generators_as_they_were():
    before = random.getstate(), np.random.get_state()[1].tolist()
    with seeded(5):
        first = random.random(), np.random.random()
    with seeded(5):
        assert (random.random(), np.random.random()) == first
    assert (random.getstate(), np.random.get_state()[1].tolist()) == before


def test_a_kept_epoch_belongs_to_all_that_it_depends_on(small_shapes):
    train, evaluation = small_shapes["train"], small_shapes["eval"]
    config = {"learning_rate": 1e-3, "batch_size": 6, "depth": 1, "channels": 2}
    longer = SETTINGS.model_copy(update={"epochs": 9, "trials": 9})
    drawn = TouchSource(lambda rng, indices: None, "some")

    def key_of(settings=SETTINGS, touches=drawn, train=train, eval_shapes=evaluation, **tried):
        return trial_key({**config, **tried}, train, eval_shapes, settings, touches)

    key = key_of()
    assert key == trial_key(dict(reversed(config.items())), train, evaluation, longer, drawn)
    others = {
        key,
        key_of(depth=2),
        key_of(train=evaluation),
        key_of(eval_shapes=train),
        key_of(SETTINGS.model_copy(update={"seed": 1})),
        key_of(SETTINGS.model_copy(update={"samples_per_epoch": 4})),
        key_of(touches=drawn._replace(key="others")),
    }
    assert len(others) == 7


def test_the_best_trial_fills_what_the_settings_leave_empty(table):
    best = table.loc[table["loss"].idxmin()]
    filled = with_best_trial(UNetSettings(), table.sample(frac=1, random_state=1))
    assert filled.learning_rate == best["learning_rate"]
    assert (filled.batch_size, filled.depth, filled.channels) == (
        best["batch_size"], best["depth"], best["channels"],
    )  # fmt: skip


def test_what_the_settings_give_stays(table):
    given = UNetSettings(learning_rate=0.5, depth=5, epochs=7)
    filled = with_best_trial(given, table)
    assert (filled.learning_rate, filled.depth, filled.epochs) == (0.5, 5, 7)
    assert None not in (filled.batch_size, filled.channels)
