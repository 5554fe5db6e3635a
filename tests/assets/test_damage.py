"""What was damaged in the store is named, and repaired by materialising the asset that is named."""

import json

import dagster as dg
import pandas as pd
import pytest
import torch
from upath import UPath

from tactile_assets.io_managers import PolicyIndex, Steps
from tactile_assets.trainings import PlannedTraining
from tactile_core.errors import TactileError
from tactile_core.exploration.policies.base import weights_version
from tactile_core.exploration.policies.store import StoredPolicy, save_policy
from tactile_core.parquet import table_hash
from tactile_core.settings import PolicySettings
from tests.payloads import payload

DATASET = ["shapenet_meshes", "masks", "rotated_splits"]


def flip(file, place: int) -> None:
    data = bytearray(file.read_bytes())
    data[place] ^= 1
    file.write_bytes(bytes(data))


def test_damaged_tables_and_meshes_are_named_and_materialising_repairs_them(platform):
    platform.materialise(*DATASET)
    whole = platform.data_versions(DATASET)
    artifacts = platform.home / "artifacts"
    for asset in ("masks", "rotated_splits"):  # both read their own last table first
        file = artifacts / f"{asset}.parquet"
        for place in (100, len(file.read_bytes()) // 2, -100, -6):
            flip(file, place)
            reader = {"masks": "rotated_splits", "rotated_splits": "outlines"}[asset]
            with pytest.raises(TactileError, match=rf"{file} .*materialise {asset} again"):
                platform.materialise(reader)
            platform.materialise(asset)
            assert platform.data_versions(DATASET) == whole

    mesh = sorted((artifacts / "shapenet_meshes").rglob("*.obj"))[0]
    before = mesh.read_bytes()
    mesh.write_bytes(before.replace(b"v 0.1", b"v 0.3", 1) + b"# altered\n")
    (artifacts / "masks.parquet").unlink()
    with pytest.raises(TactileError, match=rf"{mesh} has changed since .*shapenet_meshes again"):
        platform.materialise("masks")
    platform.materialise("shapenet_meshes")
    assert mesh.read_bytes() == before
    platform.materialise("masks", "rotated_splits")
    assert platform.data_versions(DATASET) == whole


@pytest.fixture
def policies(tmp_path) -> UPath:
    """Two stored policies and their index."""
    versions = {}
    for seed in (0, 1):
        weights = {"weight": torch.full((4,), float(seed))}
        seen = pd.DataFrame({"model_id": ["m"], "geometry": ["g"]})
        description = StoredPolicy(
            approach="total", learner="ppo", seed=seed, settings=PolicySettings(), resolution=64,
            unet="unet", key="key", version=weights_version(weights), trained_on=table_hash(seen),
        )  # fmt: skip
        directory = UPath(tmp_path, "policies", f"total-{seed}")
        save_policy(directory, description, weights, pd.DataFrame({"steps": [1]}), seen)
        versions[directory.name] = description.version
    UPath(tmp_path, "policies", "index.json").write_text(json.dumps(versions, indent=2))
    return UPath(tmp_path, "policies")


def test_an_index_of_policies_with_a_changed_bit_never_names_others(policies):
    def read() -> list[str]:
        with dg.build_input_context() as context:
            manager = PolicyIndex(base_path=policies.parent)
            return [path.name for path in manager.load_from_path(context, policies)]

    told = []
    index = policies / "index.json"
    whole = index.read_bytes()
    assert read() == ["total-0", "total-1"]
    for place in range(len(whole)):
        bit = place % 8  # one of each byte
        index.write_bytes(whole[:place] + bytes([whole[place] ^ 1 << bit]) + whole[place + 1 :])
        try:
            assert read() == ["total-0", "total-1"]
        except TactileError as error:
            told.append(str(error))
    assert len(told) > 0.9 * len(whole)
    assert all("materialise policies" in message for message in told)


def test_a_policy_that_is_not_the_one_that_the_index_tells_of_is_named(policies):
    """As another run leaves it, which trains the same policy with other settings."""
    versions = json.loads((policies / "index.json").read_bytes())
    (policies / "index.json").write_text(json.dumps({**versions, "total-1": "0" * 16}))
    with (
        dg.build_input_context() as context,
        pytest.raises(TactileError, match="total-1 is of another training"),
    ):
        PolicyIndex(base_path=policies.parent).load_from_path(context, policies)


def test_what_steps_hand_each_other_is_held_to_its_checksum(tmp_path):
    manager = Steps(base_path=UPath(tmp_path))
    planned = PlannedTraining(approach="total", seed=1, settings=PolicySettings())
    file = UPath(tmp_path, "planned.json")
    with dg.build_output_context() as out, dg.build_input_context() as into:
        manager.dump_to_path(out, planned, file)
        assert manager.load_from_path(into, file) == planned
        file.write_text(file.read_text().replace('"seed": 1', '"seed": 3'))
        with pytest.raises(TactileError, match=r"planned.json is damaged: materialise policies"):
            manager.load_from_path(into, file)


def test_what_lies_in_the_place_of_a_step_s_file_runs_nothing(tmp_path):
    file = UPath(tmp_path, "planned.json")
    file.write_bytes(payload(tmp_path / "payload-ran"))
    with (
        dg.build_input_context() as context,
        pytest.raises(TactileError, match=r"planned.json is damaged: materialise policies"),
    ):
        Steps(base_path=UPath(tmp_path)).load_from_path(context, file)
    assert not (tmp_path / "payload-ran").exists()
