"""What is fresh and what is stale after a change, as the UI shows it."""

import dagster as dg

from tactile_assets.code_versions import code_version
from tactile_assets.config import PROFILE
from tactile_assets.dagster_internals import stale_assets
from tactile_assets.definitions import defs
from tactile_assets.reconstruction import UNET_CODE
from tests.assets.running import ALL, Platform, run_for
from tests.shared import copied


def stale(platform: Platform, definitions: dg.Definitions) -> set[str]:
    """The assets that are not fresh."""
    return stale_assets(platform.instance, definitions, ALL)


def with_patience(patience: int) -> dg.Definitions:
    """The definitions as they load with this setting of the U-Net in the profile."""
    changed = PROFILE.unet.model_copy(update={"patience": patience})

    def update(spec: dg.AssetSpec) -> dg.AssetSpec:
        return spec.replace_attributes(code_version=code_version(*UNET_CODE, changed))

    return defs.map_resolved_asset_specs(func=update, selection="unet")


def test_nothing_is_stale_after_a_run(chain):
    assert stale(chain, defs) == set()


def test_a_changed_setting_makes_its_own_asset_stale_and_nothing_upstream(chain):
    assert stale(chain, with_patience(PROFILE.unet.patience)) == set()
    assert stale(chain, with_patience(PROFILE.unet.patience + 1)) == {"unet"}


def test_another_unet_makes_what_is_made_from_it_stale(chain, tmp_path):
    copied(chain.home, tmp_path / "home")
    with dg.DagsterInstance.from_config(str(tmp_path / "home" / "dagster")) as instance:
        copy = Platform(tmp_path / "home", instance)
        copy.materialise("unet", config=run_for(("unet",), unet={"epochs": 1}))
        assert stale(copy, defs) == {
            "policies",
            "reconstruction_evaluation",
            "rollouts",
        }


def test_equal_data_leaves_everything_fresh(chain, tmp_path):
    copied(chain.home, tmp_path / "home")
    with dg.DagsterInstance.from_config(str(tmp_path / "home" / "dagster")) as instance:
        copy = Platform(tmp_path / "home", instance)
        copy.materialise("outlines")
        assert stale(copy, defs) == set()
