"""Settings are written once, with bounds, and a profile sets them all."""

import pytest
from pydantic import ValidationError

from tactile_core.errors import TactileError
from tactile_core.exploration.learning.approaches import APPROACHES, find_approach
from tactile_core.exploration.policies.references import find_reference
from tactile_core.settings import PROFILES, MaskSettings, active_profile


@pytest.mark.parametrize("profile", PROFILES.values(), ids=PROFILES)
def test_every_profile_names_approaches_and_references_that_exist(profile):
    names = profile.policies.approaches or list(APPROACHES)
    assert [find_approach(name).name for name in names] == names
    for evaluation in (profile.per_step, profile.per_grasp):
        assert [find_reference(name).name for name in evaluation.references]


@pytest.mark.parametrize("profile", PROFILES.values(), ids=PROFILES)
def test_every_depth_that_a_profile_searches_fits_its_resolution(profile):
    window = profile.masks.resolution // 2
    assert all(window % 2 ** (depth - 1) == 0 for depth in profile.search.depths)


@pytest.mark.parametrize("profile", PROFILES.values(), ids=PROFILES)
def test_ppo_s_batches_divide_its_rollouts(profile):
    rays = profile.policies.environments * profile.policies.rays_per_rollout
    assert rays % profile.policies.batch_size == 0


def test_the_environment_names_the_profile_and_where_meshes_come_from():
    assert active_profile({}).name == "laptop"
    chosen = active_profile({"TACTILE_PROFILE": "smoke", "TACTILE_SHAPENET": "/data/shapenet"})
    assert (chosen.name, chosen.meshes.location) == ("smoke", "/data/shapenet")
    assert active_profile({"TACTILE_SHAPENET": ""}).meshes.location is None
    assert active_profile({"TACTILE_REAL": "/data/scans"}).real == "/data/scans"
    assert active_profile({"TACTILE_REAL": ""}).real is None


def test_an_unknown_profile_is_refused_with_the_known_ones():
    with pytest.raises(
        TactileError, match="'big' is unknown: choose one of smoke, laptop, study, paper"
    ):
        active_profile({"TACTILE_PROFILE": "big"})


@pytest.mark.parametrize("resolution", [32, 47, 1040])
def test_a_resolution_that_some_stage_cannot_work_at_is_refused(resolution):
    with pytest.raises(ValidationError, match="resolution"):
        MaskSettings(resolution=resolution)


def test_a_misspelt_setting_is_refused():
    with pytest.raises(ValidationError, match="resolutoin"):
        MaskSettings(resolutoin=64)
