"""The whole chain, from the plain command to what lies in the store and in the event log."""

import json
import math

import dagster as dg
import pandas as pd
import pytest

from tactile_assets.io_managers import PolicyIndex
from tactile_assets.metadata import numbers, shown
from tactile_assets.runs import LOCATION
from tactile_core.dataset.shapes import Shapes
from tactile_core.errors import TactileError
from tactile_core.files import content_hash
from tactile_core.parquet import read_table
from tests.assets.running import ALL, run_for, shell

TABLES = [asset for asset in ALL if asset not in ("unet", "policies")]


def metadata(platform, asset):
    event = platform.instance.get_latest_materialization_event(dg.AssetKey(asset))
    return event.asset_materialization.metadata


def test_every_step_says_what_it_does_in_one_line(finished):
    lines = finished.stderr.splitlines()
    assert any("masks " in line and "12 masks rendered" in line for line in lines)
    assert any("policies[total_0]" in line and "256/256 rays" in line for line in lines)
    assert any("check no_model_in_two_splits passed" in line for line in lines)
    assert lines[0].endswith("profile smoke")
    assert not any("DEBUG" in line or "Warning" in line or "Loading file" in line for line in lines)
    assert max(map(len, lines)) < 250


def test_a_run_of_the_command_line_is_one_of_its_job_in_the_code_location(chain):
    """Jobs and the timeline of the UI show no others."""
    [run] = chain.instance.get_runs()
    assert run.job_name == "whole_chain"
    assert run.remote_job_origin.repository_origin.get_label() == f"__repository__@{LOCATION}"
    of_the_job = dg.RunsFilter(tags={".dagster/repository": f"__repository__@{LOCATION}"})
    assert [one.run_id for one in chain.instance.get_runs(of_the_job)] == [run.run_id]


def test_artifacts_are_plain_files_under_their_names(chain):
    artifacts = chain.home / "artifacts"
    for asset in TABLES:
        assert len(read_table(artifacts / f"{asset}.parquet")), asset
    names = {path.name for path in (artifacts / "unet").iterdir()}
    assert names == {
        "model.safetensors", "settings.json", "curve.parquet", "trained_on.parquet", "seeds.json"
    }  # fmt: skip
    assert set(json.loads((artifacts / "policies" / "index.json").read_text())) == {
        "total-0",
        "gain-0",
    }
    assert (artifacts / "policies" / "total-0" / "policy.safetensors").is_file()
    assert not list(artifacts.rglob("*.part"))


def test_each_data_version_is_a_hash_of_what_is_stored(chain):
    versions = chain.data_versions(ALL)
    for asset in ("masks", "per_step_evaluation"):
        table = read_table(chain.store.path(f"{asset}.parquet"))
        from tactile_core.parquet import table_hash

        assert versions[asset] == table_hash(table.drop(columns="key", errors="ignore"))
    index = json.loads(chain.store.path("policies", "index.json").read_text())
    assert versions["policies"] == content_hash(sorted(index.items()))
    assert all(len(version) == 16 for version in versions.values())


def test_nets_learn_on_train_stop_on_eval_and_are_tested_on_test(copy_of_chain, monkeypatch):
    """What each function of the core is given, told by the samples' own splits."""
    from tactile_core.evaluation import of_each_unet
    from tactile_core.exploration.learning import train as policy_training
    from tactile_core.reconstruction import search, training

    splits = read_table(copy_of_chain.store.path("rotated_splits.parquet"))
    split_of = splits.set_index("sample_id")["split"]
    given = {}

    def watched(module, function):
        original = getattr(module, function)

        def call(*arguments, **named):
            shapes = [some for some in arguments if isinstance(some, Shapes)]
            given.setdefault(function, [set(split_of[some.sample_ids]) for some in shapes])
            return original(*arguments, **named)

        monkeypatch.setattr(module, function, call)

    watched(search, "search_unet")
    watched(training, "train_unet")
    watched(policy_training, "train_policy")
    watched(of_each_unet, "cast_rollouts")
    copy_of_chain.materialise(
        "unet_search", "unet", "policies", "rollouts", "per_step_evaluation", "per_grasp_evaluation"
    )
    assert given == {
        "search_unet": [{"train"}, {"eval"}],
        "train_unet": [{"train"}, {"eval"}],
        "train_policy": [{"train"}],
        "cast_rollouts": [{"test"}],
    }
    for evaluation in ("per_step_evaluation", "per_grasp_evaluation"):
        table = read_table(copy_of_chain.store.path(f"{evaluation}.parquet"))
        assert set(table["sample_id"]) == set(split_of[split_of == "test"].index)


def test_what_steps_hand_each_other_is_gone_after_the_run(chain):
    steps = chain.home / "artifacts" / "steps"
    assert steps.is_dir()  # here they lay
    assert not [path for path in steps.rglob("*") if path.is_file()]


def test_every_asset_shows_a_picture_and_numbers_without_a_click(chain):
    """Dagster's pages show Markdown by themselves below 1000 characters, and plot numbers alone."""
    pictures = {
        "masks": ["masks_by_class"],
        "rotated_splits": ["train_masks_by_class"],
        "outlines": ["outlines_by_class"],
        "tactile_samples": ["touches_on_outlines"],
        "unet_search": ["loss_of_each_trial"],
        "unet": ["learning_curve"],
        "reconstruction_evaluation": [
            "good_median_and_bad_reconstructions",
            "jaccard_by_number_of_touches",
        ],
        "policies": ["training_curves"],
        "rollouts": [
            "one_rollout_in_motion",
            "one_rollout_ray_by_ray",
            "random_and_the_best_policy",
        ],
        "per_step_evaluation": ["jaccard_after_each_ray"],
        "per_grasp_evaluation": ["jaccard_at_each_touch"],
    }
    for asset, names in pictures.items():
        told = metadata(chain, asset)
        assert {name for name, value in told.items() if is_picture(value)} == set(names), asset
        assert all(len(told[name].value) < 1000 for name in names), asset
        numbers = (dg.IntMetadataValue, dg.FloatMetadataValue)
        assert any(isinstance(value, numbers) for value in told.values()), asset
    assert metadata(chain, "shapenet_meshes")["meshes"].value == 12


def is_picture(value: dg.MetadataValue) -> bool:
    return isinstance(value, dg.MarkdownMetadataValue) and value.value.startswith("![")


def test_every_policy_has_numbers_that_can_be_plotted_over_runs(chain):
    for asset, last in (("per_step_evaluation", "ray 10"), ("per_grasp_evaluation", "touch 10")):
        told = metadata(chain, asset)
        policies = set(read_table(chain.store.path(f"{asset}.parquet"))["policy"])
        for name in (f"jaccard at {last}", "jaccard, mean over all"):
            plotted = {key.partition("/")[2] for key in told if key.startswith(f"{name}/")}
            assert plotted == policies, name
        shown = [record.data["policy"] for record in told["jaccard_by_policy"].records]
        assert set(shown) == policies


def test_what_is_no_number_is_not_plotted_and_a_dash_in_tables():
    summary = pd.Series({"random": 0.0, "even": math.nan, "oracle": 1})
    plotted = numbers("gap closed", summary)
    assert {name: value.value for name, value in plotted.items()} == {
        "gap closed/random": 0.0,
        "gap closed/oracle": 1.0,
    }
    told = shown(summary.rename_axis("policy").reset_index(name="gap"), {"gap": "Gap closed."})
    assert [record.data["gap"] for record in told.records] == [0.0, "-", 1.0]
    assert told.schema.columns[1].description == "Gap closed."


@pytest.mark.parametrize("asset", TABLES)
def test_every_column_of_every_table_is_described(chain, asset):
    told = metadata(chain, asset)
    table = read_table(chain.store.path(f"{asset}.parquet"))
    columns = told["dagster/column_schema"].schema.columns
    assert [column.name for column in columns] == list(table.columns)
    assert all(column.description and column.type for column in columns)
    assert told["dagster/row_count"].value == len(table)


def test_figures_lie_in_the_store(chain):
    figures = chain.home / "artifacts" / "figures"
    assert (figures / "figure_4.png").read_bytes().startswith(b"\x89PNG")
    assert (figures / "figure_5.png").read_bytes().startswith(b"\x89PNG")
    assert (figures / "run.gif").read_bytes().startswith(b"GIF8")


def test_the_results_are_printed_with_where_to_look_further(chain):
    done = shell("python -m tactile_core results", chain.home)
    assert done.returncode == 0, done.stderr
    # The run's own profile and intervals, whatever the shell names now.
    elsewhere = shell("python -m tactile_core results", chain.home, TACTILE_PROFILE="laptop")
    assert elsewhere.stdout == done.stdout
    assert "Profile smoke" in done.stdout
    for text in ("Table II", "Per step", "Per grasp", "oracle", "gain", "recall", "make ui"):
        assert text in done.stdout
    assert str(chain.home / "artifacts" / "figures") in done.stdout


def test_results_that_are_not_there_are_missed_in_one_line(tmp_path):
    done = shell("python -m tactile_core results", tmp_path)
    assert done.returncode == 1
    assert len(done.stderr.splitlines()) == 1 and "materialise" in done.stderr


def test_policies_of_every_approach_are_trained_from_what_is_stored(copy_of_chain):
    index = copy_of_chain.store.path("policies", "index.json")
    index.unlink()
    config = json.dumps(run_for(("policies",), policies={"approaches": []}))
    done = shell(
        f"dagster asset materialize --select policies --config-json '{config}'", copy_of_chain.home
    )
    assert done.returncode == 0, done.stderr
    trained = set(json.loads(index.read_text()))
    assert trained == {
        "diff-0",
        "total-0",
        "total_miss-0",
        "pre_diff_miss-0",
        "gain-0",
        "sequence-0",
    }


def test_approaches_that_are_not_trained_any_more_leave_the_index(copy_of_chain):
    settings = {"approaches": ["total"], "steps_per_stage": 256}
    copy_of_chain.materialise("policies", config={"ops": {"policies": {"config": settings}}})
    manager = PolicyIndex(base_path=copy_of_chain.store.path())
    with dg.build_input_context(asset_key=dg.AssetKey("policies")) as context:
        paths = manager.load_input(context)
    assert [path.name for path in paths] == ["total-0"]
    assert copy_of_chain.store.path("policies", "gain-0").is_dir()


def test_unchanged_masks_are_not_rendered_again(copy_of_chain):
    result = copy_of_chain.materialise("masks")
    messages = [event.user_message for event in copy_of_chain.instance.all_logs(result.run_id)]
    assert any("0 masks rendered, 12 unchanged" in message for message in messages)


def test_a_missing_upstream_asset_is_named(platform):
    with pytest.raises(TactileError, match=r"shapenet_meshes\.parquet is missing: materialise"):
        platform.materialise("masks")


def test_a_store_elsewhere_is_used(tmp_path):
    store = f"file://{tmp_path}/elsewhere"
    config = json.dumps(
        {"ops": {"shapenet_meshes": {"config": {"procedural_models": {"mug": 3, "bottle": 3}}}}}
    )
    done = shell(
        f"dagster asset materialize --select shapenet_meshes --config-json '{config}'",
        tmp_path / "home",
        TACTILE_STORE=store,
    )
    assert done.returncode == 0, done.stderr
    assert len(read_table(tmp_path / "elsewhere" / "shapenet_meshes.parquet")) == 6
    assert not (tmp_path / "home" / "artifacts").exists()
