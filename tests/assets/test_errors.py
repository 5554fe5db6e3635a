"""What a user reads when something is wrong: one clear line that says what to do."""

import json
import shutil
import zipfile

import dagster as dg
import pytest

from tactile_assets.config import RunRefused
from tactile_core.errors import TactileError
from tests.assets.running import ALL, shell

OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n"


def failure(home, select: str, config: dict | None = None, **variables: str) -> str:
    """What a failing command says beyond which step started; it must be one line."""
    command = f"dagster asset materialize --select {select}"
    if config:
        command += f" --config-json '{json.dumps({'ops': config})}'"
    done = shell(command, home, **variables)
    assert done.returncode == 1
    lines = [line for line in done.stderr.splitlines() if "FAILED" in line or "tries again" in line]
    assert len(lines) == 1, done.stderr
    assert "Traceback" not in done.stderr and "Stack Trace" not in done.stderr
    return lines[0].partition("FAILED: ")[2]


BATCHES = "batch_size (300) does not divide the 256 rays of a rollout"
PLACE = "Value at path root:ops:"
RATE = "learning_rate = 2.0: Input should be less than or equal to 1"
WRONG = [
    (
        "policies",
        {"approaches": ["tottal"]},
        f"{PLACE}policies:config:approaches[0]",
    ),
    ("shapenet_meshes", {"location": "/data/\0"}, "location = '/data/\\x00': /data/\\x00 has"),
    ("shapenet_meshes", {"location": "http://[x/"}, "http://[x/ is no address"),
    ("shapenet_meshes", {"classes": {"mug": "/data/\0.zip"}}, "classes.mug = '/data/\\x00.zip': "),
    ("shapenet_meshes", {"location": "/data/\ud800"}, "location = '/data/\\ud800': "),
    ("policies", {"batch_size": 300}, BATCHES),
    ("policies", {"seeds": [0, 0]}, "seeds names 0 twice"),
    ("policies", {"learning_rate": 2.0}, RATE),
    ("masks", {"resolution": 65}, "resolution = 65: Input should be a multiple of 16"),
    ("unet", {"patience": 0}, "patience = 0: Input should be greater than or equal to 1"),
    (
        "rollouts",
        {"references": ["rondom"]},
        f"{PLACE}rollouts:config:references[0]",
    ),
    ("per_step_evaluation", {"resamples": 1}, "resamples = 1: Input should be greater than"),
]


@pytest.mark.parametrize(("asset", "config", "reason"), WRONG)
def test_run_config_that_is_wrong_is_refused_before_there_is_a_run(platform, asset, config, reason):
    with pytest.raises((RunRefused, dg.DagsterInvalidConfigError)) as refused:
        platform.materialise(*ALL, config={"ops": {asset: {"config": config}}})
    assert reason in str(refused.value)
    assert not platform.instance.get_runs_count()
    assert not (platform.home / "artifacts").exists()


@pytest.mark.parametrize(("asset", "config", "reason"), [WRONG[0], WRONG[8]])
def test_the_command_says_it_in_one_line(tmp_path, asset, config, reason):
    config = json.dumps({"ops": {asset: {"config": config}}})
    done = shell(f"dagster asset materialize --select '*' --config-json '{config}'", tmp_path)
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].startswith(f"Error: {reason}")
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "artifacts").exists()


def test_a_missing_upstream_table_says_what_to_materialise(tmp_path):
    said = failure(tmp_path, "outlines")
    assert "rotated_splits.parquet is missing: materialise rotated_splits first" in said
    assert said.endswith("all that outlines needs: dagster asset materialize --select '*outlines'")
    needed = shell("dagster asset list --select '*outlines'", tmp_path).stdout.split()
    assert needed == ["masks", "outlines", "rotated_splits", "shapenet_meshes"]


def test_trainings_without_a_unet_stop_once_and_are_not_tried_again(copy_of_chain):
    shutil.rmtree(copy_of_chain.home / "artifacts" / "unet")
    assert "holds no trained U-Net: materialise unet first" in failure(
        copy_of_chain.home, "policies"
    )


@pytest.mark.parametrize("command", ["asset list", "definitions validate"])
def test_an_unknown_profile_ends_a_command_in_one_line(tmp_path, command):
    done = shell(f"dagster {command}", tmp_path, TACTILE_PROFILE="lapttop")
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].startswith("TACTILE_PROFILE='lapttop' is unknown: choose")
    assert "Traceback" not in done.stdout + done.stderr


def zipped(path, **members: str) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        for name, text in members.items():
            archive.writestr(name, text)


@pytest.fixture
def shapenet(tmp_path):
    """A folder with one good archive for each synset."""
    folder = tmp_path / "shapenet"
    folder.mkdir()
    for synset in ("03797390", "02876657"):
        zipped(folder / f"{synset}.zip", **{f"{synset}/a{synset}/models/model_normalized.obj": OBJ})
    return folder


def refusal(platform, location) -> str:
    """Why no meshes are read from `location`, as the asset raises it."""
    config = {"ops": {"shapenet_meshes": {"config": {"location": str(location)}}}}
    with pytest.raises(TactileError) as refused:
        platform.materialise("shapenet_meshes", config=config)
    return str(refused.value)


def test_a_missing_synset_is_named(shapenet, platform):
    (shapenet / "03797390.zip").unlink()
    said = refusal(platform, shapenet)
    assert "mug" in said and "03797390" in said


def test_a_corrupted_archive_is_named(shapenet, tmp_path):
    (shapenet / "03797390.zip").write_bytes(b"PK\x03\x04 and then nothing")
    said = failure(tmp_path / "home", "shapenet_meshes", TACTILE_SHAPENET=str(shapenet))
    assert "03797390.zip" in said


def test_an_archive_with_paths_that_escape_is_refused(shapenet, platform):
    zipped(shapenet / "03797390.zip", **{"03797390/../../evil.obj": OBJ})
    said = refusal(platform, shapenet)
    assert "03797390.zip is refused" in said and "leads out of its folder" in said


def test_a_mesh_with_nan_is_set_aside_and_the_run_goes_on(shapenet, tmp_path):
    good = {f"03797390/{name}/models/model_normalized.obj": OBJ for name in ("a", "b")}
    bad = {"03797390/c/models/model_normalized.obj": OBJ.replace("v 1 0 0", "v nan 0 0")}
    zipped(shapenet / "03797390.zip", **good, **bad)
    done = shell(
        "dagster asset materialize --select shapenet_meshes",
        tmp_path / "home",
        TACTILE_SHAPENET=str(shapenet),
    )
    assert done.returncode == 0, done.stderr
    assert "check meshes_are_usable WARN not passed: 1 of 4 meshes set aside" in done.stderr
