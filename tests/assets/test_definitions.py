"""The page that shows the whole platform, and the plain commands that read it."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import yaml

from tactile_assets.config import PROFILE
from tactile_assets.dataset import MaskConfig, MeshConfig
from tactile_assets.definitions import defs
from tactile_assets.evaluation import RolloutConfig
from tactile_assets.exploration import PolicyConfig
from tactile_assets.paths import REPOSITORY
from tactile_assets.reconstruction import SearchConfig, UNetConfig
from tactile_assets.runs import DEFINITIONS, LOCATION
from tactile_core.errors import TactileError
from tactile_core.exploration.learning.approaches import APPROACHES
from tactile_core.exploration.policies.references import REFERENCES
from tactile_core.settings import MaskSettings
from tests.assets.running import in_study, shell

IN_ORDER = [
    "shapenet_meshes",
    "masks",
    "rotated_splits",
    "outlines",
    "tactile_samples",
    "unet_search",
    "unet",
    "reconstruction_evaluation",
    "policies",
    "rollouts",
    "per_step_evaluation",
    "per_grasp_evaluation",
]
SPECS = {spec.key.to_user_string(): spec for spec in defs.resolve_all_asset_specs()}


def test_the_twelve_assets_have_the_keys_and_the_order_of_the_design():
    assert sorted(SPECS) == sorted(IN_ORDER)
    for position, asset in enumerate(IN_ORDER):
        upstream = {dep.asset_key.to_user_string() for dep in SPECS[asset].deps}
        assert upstream <= set(IN_ORDER[:position]), asset


@pytest.mark.parametrize("asset", IN_ORDER)
def test_every_asset_says_what_it_is(asset):
    spec = SPECS[asset]
    assert spec.description and len(spec.description) > 100
    assert spec.group_name in {"dataset", "reconstruction", "exploration", "evaluation"}
    assert spec.owners and 1 <= len(spec.kinds) <= 3
    assert spec.code_version
    assert spec.tags["section"] in {"IV", "V", "VI", "VII"}
    [source] = spec.metadata["dagster/code_references"].code_references
    assert Path(source.file_path).is_relative_to(REPOSITORY / "tactile_assets")


@pytest.mark.parametrize(
    ("recipe", "changed"),
    [("A reward", "policies"), ("A rule", "rollouts"), ("Another U-Net", "unet_search")],
)
def test_a_recipes_command_makes_what_it_changes_and_all_that_comes_of_it(
    recipe, changed, tmp_path
):
    text = (REPOSITORY / "README.md").read_text().partition(f"**{recipe}**")[2]
    selected = re.findall(r"dagster asset materialize --select ('.*')", text)[0]
    follows = {changed}
    for asset in IN_ORDER:
        if follows & {dep.asset_key.to_user_string() for dep in SPECS[asset].deps}:
            follows.add(asset)
    listed = shell(f"dagster asset list --select {selected}", tmp_path).stdout.split()
    assert set(listed) == follows


def test_loading_the_definitions_imports_nothing_heavy():
    heavy = ("torch", "ray", "numba", "matplotlib", "scipy", "skimage", "trimesh")
    code = (
        f"import sys, tactile_assets.definitions; print([m for m in {heavy} if m in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=REPOSITORY, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"


def test_as_many_steps_run_at_a_time_as_there_are_processors_for_this_process():
    code = """
import json, os
os.sched_setaffinity(0, list(os.sched_getaffinity(0))[:1])
from tactile_assets.definitions import STEPS
print(json.dumps(STEPS.config_schema.resolve_config({}).value["config"]["max_concurrent"]))
"""
    assert in_study(code) == 1


def test_run_config_has_the_profiles_values_and_the_ui_shows_the_cores_bounds():
    assert PolicyConfig().steps_per_stage == PROFILE.policies.steps_per_stage == 512
    shown = {
        name: field.description
        for config in (MeshConfig, MaskConfig, SearchConfig, UNetConfig)
        for name, field in config.to_config_schema().as_field().config_type.fields.items()
    }
    assert shown["resolution"] == (
        "Mask height and width R. (at least 48, at most 512, a multiple of 16)"
    )
    assert shown["procedural_models"].endswith("(each at least 0, each at most 1000000)")
    assert shown["depths"] == "Choices. (1 or more entries, each at least 1, each at most 6)"
    assert shown["batch_size"] == "Empty: best trial's. (at least 2, at most 65536)"


@pytest.mark.parametrize(
    ("config", "field", "choices"),
    [
        (PolicyConfig, "approaches", set(APPROACHES)),
        (RolloutConfig, "references", set(REFERENCES)),
        (RolloutConfig, "choices", {"likeliest", "drawn"}),
        (MaskConfig, "renderer", {"auto", "pyrender", "rasteriser"}),
    ],
)
def test_the_launchpad_offers_the_names_that_there_are(config, field, choices):
    kind = config.to_config_schema().as_field().config_type.fields[field].config_type
    while hasattr(kind, "inner_type"):  # of what may be left out, and of a list
        kind = kind.inner_type
    assert {choice.config_value for choice in kind.enum_values} == choices


def test_a_name_that_was_chosen_is_plain_text_to_the_core():
    chosen = PolicyConfig(approaches=["gain"]).model_dump()["approaches"]
    assert repr(chosen) == "['gain']"
    assert repr(RolloutConfig().choices) == repr(PROFILE.rollouts.choices)


def test_a_value_out_of_bounds_is_refused_in_one_line():
    with pytest.raises(TactileError) as caught:
        MaskConfig(resolution=65)
    assert str(caught.value) == "resolution = 65: Input should be a multiple of 16"


def test_a_config_is_a_setting_of_the_core():
    assert MaskConfig(resolution=96).model_dump() == MaskSettings(resolution=96).model_dump()


@pytest.mark.parametrize(
    ("command", "answer"),
    [
        ("dagster asset list", "per_grasp_evaluation"),
        ("dagster definitions validate", "All code locations passed validation"),
        ("dg list defs", "shapenet_meshes"),
    ],
)
def test_the_plain_commands_work_where_nothing_is_exported(command, answer, tmp_path):
    done = shell(command, tmp_path / "home")
    assert done.returncode == 0, done.stderr
    assert answer in done.stdout + done.stderr


def test_the_code_location_has_one_name_whichever_file_names_it():
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["tool"]["dg"]["project"]
    workspace = yaml.safe_load((REPOSITORY / "workspace.yaml").read_text())
    module = workspace["load_from"][0]["python_module"]
    assert module["location_name"] == project["code_location_name"] == LOCATION
    assert module["module_name"] == project["code_location_target_module"] == DEFINITIONS


def test_activation_honours_a_home_that_is_set_and_makes_it_absolute(tmp_path):
    done = shell("cd / && echo $DAGSTER_HOME; env | grep DAGSTER_MODULE_NAME", tmp_path / "here")
    assert done.stdout.split() == [str(tmp_path / "here" / "dagster")]
    assert (tmp_path / "here" / "dagster" / "dagster.yaml").is_file()


def test_an_unknown_profile_is_refused_with_the_names_of_the_known_ones(tmp_path):
    done = shell("dagster asset list", tmp_path / "home", TACTILE_PROFILE="large")
    assert done.returncode != 0
    assert (
        "TACTILE_PROFILE='large' is unknown: choose one of smoke, laptop, study, report, paper"
        in done.stderr
    )


def test_every_check_is_defined_and_those_that_guard_a_training_block():
    names = {key.name for check in defs.asset_checks for key in check.check_keys}
    assert names == {
        "meshes_are_usable",
        "masks_lie_inside_the_circle",
        "samples_lie_inside_the_circle",
        "no_model_in_two_splits",
        "classes_are_balanced",
        "touches_lie_on_outlines",
        "a_unet_can_overfit",
        "the_unet_beats_the_mean_shape",
        "trained_policies_beat_random",
        "outlines_lie_on_their_masks",
        "the_unet_is_sound",
        "policies_are_sound",
        "touches_raise_the_jaccard_index",
    }
    assert {
        spec.name for check in defs.asset_checks for spec in check.check_specs if spec.blocking
    } == {"no_model_in_two_splits", "samples_lie_inside_the_circle", "touches_lie_on_outlines"}
