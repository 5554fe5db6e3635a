"""Code versions: every asset has that of the code and the settings that compute it."""

import ast
import json
import os
import subprocess
import sys
from collections.abc import Iterator

import pytest

from tactile_assets.code_versions import code_version
from tactile_assets.config import PROFILE
from tactile_assets.definitions import defs
from tactile_assets.paths import REPOSITORY
from tactile_assets.reconstruction import UNET_CODE

SPECS = {spec.key.to_user_string(): spec for spec in defs.resolve_all_asset_specs()}
BELOW_RENDERING = {"masks", "rotated_splits"}
# A module of the core, and the assets whose content its code decides.
DECIDES = {
    "dataset.sources.parsing": {"shapenet_meshes", *BELOW_RENDERING},
    "dataset.rendering.camera": BELOW_RENDERING,
    "exploration.world.rewards": {"policies"},
    "exploration.learning.approaches": {"policies"},
    "reconstruction.search": {"unet_search"},
    "exploration.policies.recall": {"policies", "rollouts"},
    "evaluation.readings": {"per_step_evaluation", "per_grasp_evaluation"},
    "evaluation.bootstrap": {"per_step_evaluation", "per_grasp_evaluation"},
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
    assert code_version(*UNET_CODE, PROFILE.unet) == SPECS["unet"].code_version
    assert code_version(*UNET_CODE, other) != code_version(*UNET_CODE, PROFILE.unet)


@pytest.mark.parametrize("module", DECIDES)
def test_code_marks_the_assets_that_it_computes_and_no_other(module):
    command = [sys.executable, "-c", WITH_ANOTHER, module]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    versions = json.loads(done.stdout.splitlines()[-1])
    assert set(versions) == set(SPECS)
    changed = {name for name, spec in SPECS.items() if spec.code_version != versions[name]}
    assert changed == DECIDES[module]


# The modules of the core whose code counts for each asset, of a profile that has all of them.
COUNTED = """
import json
from tactile_assets import code_versions
from tactile_core import keys
of_parts, counted = code_versions.code_version, {}

def noted(*parts):
    version = of_parts(*parts)
    counted[version] = keys.closure(tuple(part for part in parts if isinstance(part, str)))
    return version

code_versions.code_version = noted
from tactile_assets.definitions import defs
specs = defs.resolve_all_asset_specs()
print(json.dumps({spec.key.to_user_string(): counted[spec.code_version] for spec in specs}))
"""
WINGS = ("dataset", "reconstruction", "exploration", "evaluation", "real")
# Pictures, what stands in the metadata, and what refuses an input are no part of what is stored.
SHOWN = (
    "tactile_core.figures.",
    "tactile_core.evaluation.tables",
    "tactile_core.evaluation.unseen",
    "tactile_core.errors",
)


def functions() -> dict[str, ast.FunctionDef]:
    """Every function of the modules that define assets, by name."""
    trees = [ast.parse((REPOSITORY / f"tactile_assets/{wing}.py").read_text()) for wing in WINGS]
    return {node.name: node for tree in trees for node in tree.body
            if isinstance(node, ast.FunctionDef)}  # fmt: skip


def run_by(asset: str) -> Iterator[str]:
    """The modules of the core that an asset's function imports, or one that it calls."""
    found = functions()
    waiting, met = [asset], set()
    while waiting:
        name = waiting.pop()
        if name in found.keys() - met:
            met.add(name)
            nodes = list(ast.walk(found[name]))
            called = [node.func for node in nodes if isinstance(node, ast.Call)]
            waiting += [some.id for some in called if isinstance(some, ast.Name)]
            yield from (node.module for node in nodes if isinstance(node, ast.ImportFrom))


# Decides where something is computed, and not what: `keys.APART`.
WHERE = {"tactile_core.spread"}


def test_all_code_that_an_asset_runs_counts():
    everything = {**os.environ, "TACTILE_PROFILE": "study", "TACTILE_REAL": "/somewhere"}
    done = subprocess.run(
        [sys.executable, "-c", COUNTED], env=everything, capture_output=True, text=True, check=True
    )
    counted = json.loads(done.stdout.splitlines()[-1])
    assert {"practice_rays", "attainable_rollouts", "real_shapes", *SPECS} <= set(counted)
    for asset, modules in counted.items():
        run = {module for module in run_by(asset) if module.startswith("tactile_core.")}
        assert {module for module in run if not module.startswith(SHOWN)} - WHERE <= set(modules), (
            asset
        )
