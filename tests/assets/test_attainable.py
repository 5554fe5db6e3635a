"""What can be attained: the ideal observers are assets of the profile `study`."""

import shutil

from tactile_core.evaluation.tables import policy_results
from tactile_core.parquet import read_table
from tests.assets.running import in_study

OBSERVE = """
import json, sys
from pathlib import Path
import dagster as dg
from tactile_assets.fresh import stored_version
from tactile_core.exploration.policies import observer
from tactile_core.parquet import read_table
from tests.assets.running import Platform, run_for

observer.ROUNDS, observer.SECOND, observer.BEYOND = ((2, 2), (1, 1)), 2, 2
few = {"believed": {"mug": 2, "bottle": 2}, "samples": 2}
platform = Platform(Path(sys.argv[1]), dg.DagsterInstance.ephemeral())
for name in ("believed_shapes", "attainable_rollouts", "attainable_evaluation"):
    settings = {} if name == "attainable_evaluation" else {name: few}
    platform.materialise(name, config=run_for((name,), **settings))
believed = read_table(platform.store.path("believed_shapes.parquet"))
known = read_table(platform.store.path("rotated_splits.parquet"))
for name in ("believed_shapes", "attainable_rollouts", "attainable_evaluation"):
    assert stored_version(platform.store, name) == platform.data_versions([name])[name], name
print(json.dumps({"strangers": not set(believed["geometry"]) & set(known["geometry"])}))
"""

FOLLOW = """
import json
import dagster as dg
from tactile_assets.definitions import defs

every = [spec.key for spec in defs.resolve_all_asset_specs()]
asked, cursor = [], None
with dg.DagsterInstance.ephemeral() as instance:
    for new in (every, [], [dg.AssetKey("policies")]):
        for key in new:
            instance.report_runless_asset_event(dg.AssetMaterialization(key))
        tick = dg.evaluate_automation_conditions(defs, instance, cursor=cursor)
        cursor = tick.cursor
        asked = sorted(key.to_user_string() for key in every if tick.get_num_requested(key))
print(json.dumps(asked))
"""


def test_the_ideal_observers_follow_new_policies_as_all_evaluations_do():
    assert in_study(FOLLOW) == [
        "attainable_evaluation",
        "attainable_rollouts",
        "per_grasp_evaluation",
        "per_step_evaluation",
        "rollouts",
    ]


def test_the_study_tells_how_much_of_what_can_be_attained_each_policy_attains(chain, tmp_path):
    shutil.copytree(chain.home / "artifacts", tmp_path / "artifacts")
    assert in_study(OBSERVE, str(tmp_path)) == {"strangers": True}
    table = read_table(tmp_path / "artifacts" / "attainable_evaluation.parquet")
    assert {"observer", "observer_ahead", "random", "recall"} <= set(table["policy"])
    rows = policy_results(table, "step", 20, 0).rows.set_index("policy")
    assert table.groupby("policy")["sample_id"].nunique().eq(2).all()
    assert {"attained at 10", "attained, mean"} <= set(rows)
