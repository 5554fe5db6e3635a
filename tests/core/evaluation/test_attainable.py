"""What can be attained: the ideal observers beside the policies, on the same samples."""

import pandas as pd
import pytest

from tactile_core.errors import TactileError
from tactile_core.evaluation import attainable
from tactile_core.evaluation.attainable import attainable_reading, cast_observers, one_of_each
from tactile_core.evaluation.rollouts import cast_rollouts, code_behind
from tactile_core.evaluation.statistics import summarise_steps
from tactile_core.exploration.policies import observer
from tactile_core.exploration.policies.scorer import RayScorer
from tactile_core.keys import closure
from tactile_core.reconstruction.known_shapes import KnownShapes
from tactile_core.settings import EvaluationSettings, ObserverSettings, RolloutSettings

SETTINGS = ObserverSettings(samples=2)
READ = EvaluationSettings(resamples=50)


@pytest.fixture(scope="module")
def quick():
    """Few draws: what is tested holds for any number."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(observer, "ROUNDS", ((2, 2), (1, 1)))
        for name in ("SECOND", "BEYOND"):
            patch.setattr(observer, name, 2)
        yield


@pytest.fixture(scope="module")
def observed(quick, shapes, unet):
    belief = shapes["train"].masks
    return cast_observers(shapes["test"], 0, unet, belief, RayScorer().eval(), SETTINGS)


@pytest.fixture(scope="module")
def rollouts(shapes, unet):
    settings = RolloutSettings(references=["random", "even"], ray_limit=20)
    return cast_rollouts([], shapes["test"], unet, settings)


def test_observers_cast_ten_rays_on_one_sample_of_each_model(observed):
    assert set(observed["policy"]) == {"observer", "observer_ahead"}
    assert observed["sample_id"].nunique() == observed["model_id"].nunique() == 2
    assert (observed.groupby(["policy", "sample_id"]).size() == 10).all()


def test_a_killed_run_keeps_what_observers_cast_of_some_samples_at_a_time(
    quick, shapes, unet, tmp_path, monkeypatch
):
    monkeypatch.setattr(attainable, "SAMPLES_AT_A_TIME", 1)
    belief = shapes["train"].masks

    def observe(progress):
        return cast_observers(
            shapes["test"], 0, unet, belief, None, SETTINGS, progress=progress, work=tmp_path
        )

    def killed(message: str) -> None:
        if message.startswith("1 of 2 samples are done"):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        observe(killed)
    asked = []
    choose = observer.IdealObserver.choose_one

    def counted(self, one, rng):
        asked.append(one)
        return choose(self, one, rng)

    monkeypatch.setattr(observer.IdealObserver, "choose_one", counted)
    table = observe(lambda message: None)
    assert len(asked) == 10  # of the second sample alone
    assert (table.groupby("sample_id").size() == 10).all()
    assert table["sample_id"].nunique() == 2


def test_samples_are_spread_over_the_models(shapes):
    test = shapes["test"]
    models = len(set(test.model_ids))
    every = one_of_each(test, 10**6)
    assert len(every) == len(set(every.model_ids)) == models
    assert len(one_of_each(test, models - 1)) == models - 1


def test_policies_are_measured_by_what_the_observers_attain_on_the_same_samples(observed, rollouts):
    table = attainable_reading(observed, rollouts, READ)
    assert table.groupby("policy")["sample_id"].nunique().eq(2).all()
    summary = summarise_steps(table, resamples=50).set_index("policy")
    assert summary.loc["random", "mean_attained"] == 0
    best = summary.loc[["observer", "observer_ahead"], "mean"].idxmax()
    assert summary.loc[best, "mean_attained"] == 1
    room = summary.loc[best, "mean"] - summary.loc["random", "mean"]
    share = (summary.loc["even", "mean"] - summary.loc["random", "mean"]) / room
    assert summary.loc["even", "mean_attained"] == pytest.approx(share)


def test_observers_are_compared_with_what_had_the_same_unet(observed, rollouts):
    of_another = rollouts.assign(seed=1, jaccard=0.0)
    both = attainable_reading(observed, pd.concat([rollouts, of_another]), READ)
    pd.testing.assert_frame_equal(both, attainable_reading(observed, rollouts, READ))


def test_rollouts_on_other_samples_are_told(observed, rollouts):
    lacking = rollouts[rollouts["sample_id"] != observed["sample_id"].iloc[0]]
    with pytest.raises(TactileError, match="materialise attainable_rollouts again"):
        attainable_reading(observed, lacking, READ)


def test_rays_of_an_observer_are_cast_anew_where_its_code_changes(shapes):
    policy = observer.IdealObserver(KnownShapes(shapes["train"].masks[:1]))
    assert observer.__name__ in closure(tuple(code_behind(policy)))
