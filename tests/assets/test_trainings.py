"""Each training is a step of its own: tried again where that may help, refused where it cannot."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import dagster as dg
import pytest

from tactile_assets import exploration
from tactile_assets.io_managers import PolicyIndex
from tactile_core.errors import TactileError
from tactile_core.exploration.learning import train as core
from tactile_core.parquet import read_table
from tactile_core.profiles import PROFILES
from tactile_core.reconstruction.unets import load_unets
from tests.assets.running import TINY, shell
from tests.disks import small_disk

ONE = {
    "ops": {"policies": {"config": {"approaches": ["total"], "seeds": [3], "steps_per_stage": 256}}}
}


@pytest.fixture
def failing(monkeypatch):
    """Lets the first call of the core's training fail with the error that a test names."""
    train, calls = core.train_policy, []

    def train_policy(*arguments, **named):
        calls.append(arguments)
        if len(calls) == 1:
            raise failing.error
        return train(*arguments, **named)

    failing = train_policy
    monkeypatch.setattr(core, "train_policy", train_policy)
    return train_policy


def retries(result: dg.ExecuteInProcessResult) -> list[str | None]:
    kind = dg.DagsterEventType.STEP_UP_FOR_RETRY
    return [event.step_key for event in result.all_events if event.event_type == kind]


def test_a_training_that_breaks_off_is_tried_again_on_its_own(copy_of_chain, failing):
    failing.error = OSError("the disk was away")
    result = copy_of_chain.materialise("policies", config=ONE)
    assert result.success
    # What its steps handed each other lay in the store, where other machines could read it.
    assert copy_of_chain.store.path("steps").exists()
    assert not copy_of_chain.store.path("steps", result.run_id).exists()
    assert retries(result) == ["policies.train_policy[total_3]"]


def test_a_run_that_could_not_store_its_index_can_be_executed_again_from_there(
    copy_of_chain, monkeypatch
):
    def write_index(*arguments):
        raise OSError("the store is full")

    monkeypatch.setattr("tactile_core.exploration.policies.index.write_index", write_index)
    result = copy_of_chain.materialise("policies", config=ONE, raise_on_error=False)
    assert not result.success
    handed = copy_of_chain.store.path("steps", result.run_id)
    assert [path for path in handed.rglob("*.json") if "total_3" in str(path)]


def test_a_training_that_a_user_has_to_mend_is_not_tried_again(copy_of_chain, failing):
    failing.error = TactileError("batch_size is too large: choose a smaller one")
    with pytest.raises(dg.Failure, match="batch_size is too large"):
        copy_of_chain.materialise("policies", config=ONE)
    assert not copy_of_chain.store.path("policies", "total-3").exists()


def test_a_fault_in_the_code_is_not_tried_again(copy_of_chain, failing):
    failing.error = TypeError("rays must be integers")
    with pytest.raises(dg.Failure, match="rays must be integers"):
        copy_of_chain.materialise("policies", config=ONE)


def test_a_full_store_stops_a_training_in_one_line_and_keeps_what_it_holds(chain, platform):
    artifacts = platform.home / "artifacts"
    with small_disk(artifacts, kilobytes=40_000) as fill:
        shutil.copytree(chain.home / "artifacts", artifacts, dirs_exist_ok=True)
        before = {file: file.read_bytes() for file in files_in(artifacts)}
        fill()
        result = platform.materialise("policies", config=ONE, raise_on_error=False)
        said = str(result.all_events)
        assert "cannot be written (No space left on device): make room" in said
        assert not retries(result)
        assert {file: file.read_bytes() for file in files_in(artifacts)} == before


def files_in(folder: Path) -> list[Path]:
    return [file for file in folder.rglob("*") if file.is_file() and file.name != "filled"]


def planned(platform, unets, **fields) -> list[str]:
    store, config = platform.store, exploration.PolicyConfig(**fields)
    splits, outlines = (
        read_table(store.path(f"{name}.parquet")) for name in ("rotated_splits", "outlines")
    )
    trainings = exploration.plan_trainings(config, splits, outlines, unets)
    return [output.value.name for output in trainings]


def test_each_approach_is_trained_once_with_each_seed_the_longest_first(chain):
    unets = load_unets(chain.store.path("unet"))
    names = planned(chain, unets, approaches=["total", "gain", "total_miss"], seeds=[0, 7])
    assert names == ["gain-0", "gain-7", "total_miss-0", "total_miss-7", "total-0", "total-7"]


def test_a_unet_of_another_resolution_stops_before_any_training(chain):
    [unet] = load_unets(chain.store.path("unet")).values()
    with pytest.raises(TactileError, match="resolution 64, and the U-Net was trained at 96"):
        planned(chain, {0: replace(unet, resolution=96)})


def test_a_seed_without_a_unet_of_its_own_stops_before_any_training(chain):
    [unet] = load_unets(chain.store.path("unet")).values()
    unets = {0: unet, 1: unet}
    assert planned(chain, unets, approaches=["diff"], seeds=[1]) == ["diff-1"]
    with pytest.raises(TactileError, match=r"no U-Net of seed 2 .* but of seeds 0, 1: add it to"):
        planned(chain, unets, seeds=[0, 2])


@pytest.mark.parametrize(
    "index",
    [["total-0"], 5, {"total-0": None}, {"total-0": ["x"]}, {"../x": "1"}, {"total-0": "another"}],
)
def test_an_index_with_something_else_in_it_is_told_in_one_line(copy_of_chain, index):
    (copy_of_chain.store.path("policies") / "index.json").write_text(json.dumps(index))
    with pytest.raises(TactileError, match="materialise policies again"):
        loaded(copy_of_chain)


def test_a_policy_under_the_name_of_another_is_told(copy_of_chain):
    folder = copy_of_chain.home / "artifacts" / "policies"
    index = json.loads((folder / "index.json").read_text())
    shutil.copytree(folder / "total-0", folder / "total-1")
    (folder / "index.json").write_text(json.dumps(index | {"total-1": index["total-0"]}))
    with pytest.raises(TactileError, match="total-1 is of another training"):
        loaded(copy_of_chain)


def loaded(platform):
    """The policies' directories, as an evaluation is given them."""
    manager = PolicyIndex(base_path=platform.store.path())
    return manager.load_from_path(dg.build_input_context(), platform.store.path("policies"))


def test_on_a_gpu_one_training_at_a_time(copy_of_chain):
    """Without the pool both would begin at once: each is a process of its own."""
    home = copy_of_chain.home
    fields = {**PROFILES["smoke"].policies.model_dump(), **TINY["policies"]}
    config = home / "config.json"
    config.write_text(json.dumps({"ops": {"policies": {"config": fields}}}))
    done = shell(
        f"dagster asset materialize -m tests.assets.gpu_platform --select policies -c {config}",
        home, TACTILE_PROFILE="laptop",
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    with dg.DagsterInstance.from_config(str(home / "dagster")) as instance:
        [run] = instance.get_runs()
        spans = {}
        for event in instance.all_logs(run.run_id):
            if event.step_key and event.step_key.startswith("policies.train_policy"):
                kind = event.dagster_event and event.dagster_event.event_type_value
                if kind in ("STEP_START", "STEP_SUCCESS"):
                    spans.setdefault(event.step_key, []).append(event.timestamp)
        (_, end), (start, _) = sorted(spans.values())
        assert end <= start
        assert instance.event_log_storage.get_concurrency_info("gpu").slot_count == 1
