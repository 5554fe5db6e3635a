"""`practice_rays`: an asset of its own where the profile practises, and nowhere else."""

import shutil

from tactile_assets.definitions import defs
from tactile_core.dataset.shapes import load_shapes
from tactile_core.exploration.practice.ray_touches import practised
from tactile_core.exploration.world.rays import RAYS
from tactile_core.parquet import read_table
from tests.assets.running import in_study

UPSTREAM = """
import json
from tactile_assets.definitions import defs
specs = defs.resolve_all_asset_specs()
print(json.dumps({spec.key.to_user_string(): sorted(dep.asset_key.to_user_string()
                                                    for dep in spec.deps) for spec in specs}))
"""
PRACTISE = """
import json, sys
from pathlib import Path
import dagster as dg
from tactile_assets.fresh import stored_version
from tactile_core.errors import TactileError
from tactile_core.parquet import read_table, write_table
from tests.assets.running import Platform, run_for

QUICK = {"epochs": 1, "gain_iterations": 2, "gain_states": 4, "gain_tries": 2, "gain_updates": 1}
platform = Platform(Path(sys.argv[1]), dg.DagsterInstance.ephemeral())
table = platform.store.path("practice_rays.parquet")

def unet() -> str:
    platform.materialise("unet", config=run_for(("unet",), unet={"epochs": 1}))
    return platform.data_versions(["unet"])["unet"]

try:
    unet()
except TactileError as error:
    refused = str(error)
platform.materialise("practice_rays", config=run_for(("practice_rays",), practice_rays=QUICK))
made = platform.data_versions(["practice_rays"])["practice_rays"]
assert stored_version(platform.store, "practice_rays") == made
first, again = unet(), unet()
recorded = read_table(table)
write_table(recorded[recorded["sequence"] < 3], table)
fewer = unet()
write_table(recorded, table)
print(json.dumps({"refused": refused, "same": first == again, "read": first != fewer}))
"""


def test_practice_stands_before_the_unet_where_the_profile_practises():
    upstream = in_study(UPSTREAM)
    assert upstream["practice_rays"] == ["outlines", "rotated_splits", "unet_search"]
    assert "practice_rays" in upstream["unet"]
    smoke = {spec.key.to_user_string(): spec for spec in defs.resolve_all_asset_specs()}
    observers = {"believed_shapes", "attainable_rollouts", "attainable_evaluation"}
    assert set(upstream) - set(smoke) == {"practice_rays", *observers}
    assert "practice_rays" not in {dep.asset_key.to_user_string() for dep in smoke["unet"].deps}


def test_the_unet_learns_from_the_rays_that_practice_stored(chain, tmp_path):
    shutil.copytree(chain.home / "artifacts", tmp_path / "artifacts")
    found = in_study(PRACTISE, str(tmp_path))
    assert "practice_rays.parquet is missing: materialise practice_rays" in found["refused"]
    assert found["same"] and found["read"]
    store = tmp_path / "artifacts"
    splits, outlines = (read_table(store / f"{n}.parquet") for n in ("rotated_splits", "outlines"))
    train = load_shapes(splits, outlines, "train")
    table = read_table(store / "practice_rays.parquet")
    assert list(table) == ["sample_id", "sequence", "policy", "strays", "rays", "touches", "key"]
    assert dict(table["policy"].value_counts()) == {
        "gain": 4 * len(train),
        "coverage": 2 * len(train),
    }
    assert practised(table, train).rays.shape == (len(train), 6, RAYS, 2)
    left = (tmp_path / "cache" / "practice_rays").iterdir()  # until it is seen to be stored
    assert [file.name for file in left] == ["finished.parquet"]
