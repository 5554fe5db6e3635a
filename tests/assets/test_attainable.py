"""What can be attained: the ideal observers are assets of the profile `study`."""

import shutil

from tactile_core.evaluation.tables import policy_results
from tactile_core.files import read_table
from tests.assets.running import in_study

OBSERVE = """
import json, sys
from pathlib import Path
import dagster as dg
from tactile_core.exploration.policies import observer
from tactile_core.files import read_table
from tests.assets.running import Platform, run_for

observer.ROUNDS, observer.SECOND, observer.BEYOND = ((2, 2), (1, 1)), 2, 2
few = {"believed": {"mug": 2, "bottle": 2}, "samples": 2}
platform = Platform(Path(sys.argv[1]), dg.DagsterInstance.ephemeral())
for name in ("believed_shapes", "attainable_rollouts", "attainable_evaluation"):
    settings = {} if name == "attainable_evaluation" else {name: few}
    platform.materialise(name, config=run_for((name,), **settings))
believed = read_table(platform.store.path("believed_shapes.parquet"))
known = read_table(platform.store.path("rotated_splits.parquet"))
print(json.dumps({"strangers": not set(believed["geometry"]) & set(known["geometry"])}))
"""


def test_the_study_tells_how_much_of_what_can_be_attained_each_policy_attains(chain, tmp_path):
    shutil.copytree(chain.home / "artifacts", tmp_path / "artifacts")
    assert in_study(OBSERVE, str(tmp_path)) == {"strangers": True}
    table = read_table(tmp_path / "artifacts" / "attainable_evaluation.parquet")
    assert {"observer", "observer_ahead", "random", "recall"} <= set(table["policy"])
    rows = policy_results(table, "step", 20, 0).rows.set_index("policy")
    assert table.groupby("policy")["sample_id"].nunique().eq(2).all()
    assert {"attained at 10", "attained, mean"} <= set(rows)
