"""Code versions: every asset has that of the code and the settings that compute it."""

import json
import subprocess
import sys

import pytest

from tactile_assets.code_versions import code_version
from tactile_assets.config import PROFILE
from tactile_assets.definitions import defs

SPECS = {spec.key.to_user_string(): spec for spec in defs.resolve_all_asset_specs()}
UNET = "reconstruction.training", "exploration.practice.ray_touches"
EVALUATIONS = {"per_step_evaluation", "per_grasp_evaluation"}
BELOW_RENDERING = {"masks", "rotated_splits"}
# A module of the core, and the assets whose content its code decides.
DECIDES = {
    "dataset.sources.parsing": {"shapenet_meshes", *BELOW_RENDERING},
    "dataset.rendering.camera": BELOW_RENDERING,
    "exploration.world.rewards": {"policies"},
    "exploration.learning.approaches": {"policies"},
    "reconstruction.search": {"unet_search"},
    "exploration.policies.recall": {"policies", *EVALUATIONS},
    "figures.curves": set(),
}
WITH_ANOTHER = """
import json, os, sys
os.environ["TACTILE_PROFILE"] = "smoke"
from tactile_core import keys
before = keys.code_of
changed = "tactile_core." + sys.argv[1]
keys.code_of = lambda module: "another" if module == changed else before(module)
from tactile_assets.definitions import defs
print(json.dumps({s.key.to_user_string(): s.code_version for s in defs.resolve_all_asset_specs()}))
"""


def test_settings_of_a_stage_count():
    other = PROFILE.unet.model_copy(update={"epochs": PROFILE.unet.epochs + 1})
    assert code_version(*UNET, PROFILE.unet) == SPECS["unet"].code_version
    assert code_version(*UNET, other) != code_version(*UNET, PROFILE.unet)


@pytest.mark.parametrize("module", DECIDES)
def test_code_marks_the_assets_that_it_computes_and_no_other(module):
    command = [sys.executable, "-c", WITH_ANOTHER, module]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    versions = json.loads(done.stdout.splitlines()[-1])
    assert set(versions) == set(SPECS)
    changed = {name for name, spec in SPECS.items() if spec.code_version != versions[name]}
    assert changed == DECIDES[module]
