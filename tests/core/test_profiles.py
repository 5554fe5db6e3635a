"""A profile sets every setting, and the environment names one."""

import pytest

from tactile_core.errors import TactileError
from tactile_core.exploration.learning.approaches import APPROACHES, find_approach
from tactile_core.profiles import PROFILES, active_profile


@pytest.mark.parametrize("profile", PROFILES.values(), ids=PROFILES)
def test_every_profile_names_approaches_that_exist_and_leaves_out_no_rule(profile):
    names = profile.policies.approaches or list(APPROACHES)
    assert [find_approach(name).name for name in names] == names
    assert profile.rollouts.references is None  # every one there is


@pytest.mark.parametrize("profile", PROFILES.values(), ids=PROFILES)
def test_every_profile_casts_what_its_evaluations_read(profile):
    for evaluation in (profile.per_step, profile.per_grasp):
        assert evaluation.choice in profile.rollouts.choices
        assert evaluation.count <= profile.rollouts.count
    assert {one.choice for one in (profile.per_step, profile.per_grasp)} == set(
        profile.rollouts.choices
    )


@pytest.mark.parametrize("profile", PROFILES.values(), ids=PROFILES)
def test_every_depth_that_a_profile_searches_fits_its_resolution(profile):
    window = profile.masks.resolution // 2
    assert all(window % 2 ** (depth - 1) == 0 for depth in profile.search.depths)


def test_the_environment_names_the_profile_and_where_meshes_come_from(tmp_path):
    home = {"TACTILE_HOME": str(tmp_path)}
    assert active_profile(home).name == "laptop"
    (tmp_path / "profile").write_text("smoke")
    assert active_profile(home).name == "smoke"
    assert active_profile({**home, "TACTILE_PROFILE": "study"}).name == "study"
    chosen = active_profile({"TACTILE_PROFILE": "smoke", "TACTILE_SHAPENET": "/data/shapenet"})
    assert (chosen.name, chosen.meshes.location) == ("smoke", "/data/shapenet")
    assert active_profile({"TACTILE_SHAPENET": ""}).meshes.location is None
    assert active_profile({"TACTILE_REAL": "/data/scans"}).real == "/data/scans"
    assert active_profile({"TACTILE_REAL": ""}).real is None


def test_an_unknown_profile_is_refused_with_the_known_ones():
    with pytest.raises(
        TactileError, match="'big' is unknown: choose one of smoke, laptop, study, report, paper"
    ):
        active_profile({"TACTILE_PROFILE": "big"})
