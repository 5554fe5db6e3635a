"""Settings are written once, with bounds."""

import pytest
from pydantic import ValidationError

from tactile_core.exploration.policies.scorer import ANGLES, OFFSETS
from tactile_core.settings import (
    EvaluationSettings,
    GainSettings,
    MaskSettings,
    MeshSettings,
    PolicySettings,
    RolloutSettings,
    SearchSettings,
    SplitSettings,
    TouchSettings,
    UNetSettings,
    problems,
)


@pytest.mark.parametrize("resolution", [32, 47, 1040])
def test_a_resolution_that_some_stage_cannot_work_at_is_refused(resolution):
    with pytest.raises(ValidationError, match="resolution"):
        MaskSettings(resolution=resolution)


def test_a_misspelt_setting_is_refused():
    with pytest.raises(ValidationError, match="resolutoin"):
        MaskSettings(resolutoin=64)


@pytest.mark.parametrize(
    ("settings", "fields", "reason"),
    [
        (TouchSettings, {"fewest": 3, "most": 2}, "fewest (3) exceeds most (2)"),
        (TouchSettings, {"fewest": 11}, "fewest (11) exceeds most (10)"),
        (SplitSettings, {"eval_share": 0.45, "test_share": 0.45}, "leave too little for train"),
        (
            SearchSettings,
            {"learning_rate": [1e-2, 1e-3]},
            "lower end (0.01) is not below the upper",
        ),
        (SearchSettings, {"learning_rate": [1e-3, 1e-3]}, "is not below the upper"),
        (SearchSettings, {"learning_rate": [1e-3]}, "learning_rate = [0.001]"),
        (SearchSettings, {"learning_rate": [1e-3, float("inf")]}, "learning_rate.1 = inf"),
        (SearchSettings, {"batch_sizes": []}, "batch_sizes = []"),
        (SearchSettings, {"batch_sizes": [8, 16, 8]}, "batch_sizes names 8 twice"),
        (SearchSettings, {"depths": [3, 3]}, "depths names 3 twice"),
        (SearchSettings, {"channels": [4, 4]}, "channels names 4 twice"),
        (SearchSettings, {"channels": [0]}, "channels.0 = 0"),
        (UNetSettings, {"learning_rate": float("inf")}, "learning_rate = inf"),
        (UNetSettings, {"learning_rate": float("nan")}, "learning_rate = nan"),
        (UNetSettings, {"epochs": None}, "epochs = None"),
        (PolicySettings, {"learning_rate": float("inf")}, "learning_rate = inf"),
        (PolicySettings, {"reward_scale": float("inf")}, "reward_scale = inf"),
        (PolicySettings, {"entropy": float("nan")}, "entropy = nan"),
        (PolicySettings, {"gain_learning_rate": float("inf")}, "gain_learning_rate = inf"),
        (PolicySettings, {"seeds": []}, "seeds = []"),
        (PolicySettings, {"seeds": [0, 1, 0]}, "seeds names 0 twice"),
        (PolicySettings, {"seeds": [10**19]}, "seeds.0 = 10000000000000000000"),
        (PolicySettings, {"approaches": ["diff", "diff"]}, "approaches names 'diff' twice"),
        (PolicySettings, {"batch_size": 1024}, "batch_size (1024) does not divide the 512 rays"),
        (PolicySettings, {"environments": 10}, "batch_size (256) does not divide the 160 rays"),
        (RolloutSettings, {"ray_limit": 9}, "count (10) exceeds ray_limit (9)"),
        (RolloutSettings, {"ray_limit": 10**19}, "ray_limit = 10000000000000000000"),
        (RolloutSettings, {"references": ["even", "even"]}, "references names 'even' twice"),
        (RolloutSettings, {"choices": []}, "choices = []"),
        (
            RolloutSettings,
            {"choices": ["best"]},
            "choice 'best' is unknown: choose",
        ),
        (EvaluationSettings, {"choice": "rule"}, "choice = 'rule'"),
        (MeshSettings, {"classes": {}}, "classes = {}"),
        (MeshSettings, {"classes": {"a": "03797390", "b": "03797390"}}, "names '03797390' twice"),
        (MeshSettings, {"sha256": {"cup": "0" * 64}}, "sha256 names 'cup'"),
        (MeshSettings, {"procedural_models": {"mug": -1}}, "procedural_models.mug = -1"),
        *(
            (settings, {"seed": seed}, f"seed = {seed}")
            for settings in (MeshSettings, SplitSettings, UNetSettings, EvaluationSettings)
            for seed in (10**19, 2**32, -1)
        ),
    ],
)
def test_settings_that_cannot_be_honoured_are_refused_in_one_line(settings, fields, reason):
    with pytest.raises(ValidationError) as refused:
        settings(**fields)
    assert reason in problems(refused.value)
    assert "\n" not in problems(refused.value)


def test_no_more_touches_may_be_tried_than_there_are_candidate_rays():
    assert GainSettings(gain_tries=ANGLES * OFFSETS)
    with pytest.raises(ValidationError, match="gain_tries"):
        GainSettings(gain_tries=ANGLES * OFFSETS + 1)
