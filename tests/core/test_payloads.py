"""What somebody else put where we read runs no code of theirs."""

import ast
import io
import zipfile
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import torch
from upath import UPath

from tactile_core.checkpoints import load_checkpoint
from tactile_core.errors import DamagedError, TactileError
from tactile_core.exploration.learning.approaches import find_approach
from tactile_core.exploration.learning.train import train_policy
from tactile_core.exploration.policies.store import load_policies
from tactile_core.parquet import read_table
from tactile_core.reconstruction.trained import load_unet, save_unet
from tactile_core.settings import PolicySettings
from tests.payloads import Payload, payload

QUICK = PolicySettings(
    steps_per_stage=64, environments=4, rays_per_rollout=16, batch_size=16, epochs=1
)


@pytest.fixture
def trace(tmp_path) -> Path:
    return tmp_path / "payload-ran"


@pytest.fixture
def planted(trace) -> bytes:
    return payload(trace)


def test_a_checkpoint_runs_nothing(planted, trace, tmp_path):
    for name, write in {
        "pickle": lambda path: path.write_bytes(planted),
        "torch": lambda path: torch.save({"key": "key", "state": Payload(trace)}, path),
        "in a container": lambda path: torch.save(
            {"key": "key", "state": {"curve": [Payload(trace)]}}, path
        ),
    }.items():
        write(tmp_path / name)
        assert load_checkpoint(tmp_path / name, "key") is None
        assert not trace.exists()


def test_a_policy_runs_nothing(planted, trace, shapes, unet, tmp_path):
    directory = UPath(tmp_path / "total-0")
    train_policy(
        find_approach("total"), 0, shapes["train"], unet, QUICK,
        directory=directory, work=tmp_path / "work",
    )  # fmt: skip
    for file in sorted(tmp_path.joinpath("total-0").iterdir()):
        whole = file.read_bytes()
        file.write_bytes(planted)
        if file.name == "policy.zip":  # for users of Stable-Baselines3, and never read
            with zipfile.ZipFile(file, "w") as archive:
                archive.writestr("data", planted)
            load_policies([directory], unet.version(), 64)
        elif file.name in ("policy.safetensors", "settings.json"):
            with pytest.raises(TactileError, match="materialise policies"):
                load_policies([directory], unet.version(), 64)
        assert not trace.exists()
        file.write_bytes(whole)


def test_a_unet_runs_nothing(planted, trace, unet, tmp_path):
    directory = UPath(tmp_path / "unet")
    save_unet(unet, directory)
    for file in sorted(tmp_path.joinpath("unet").iterdir()):
        whole = file.read_bytes()
        file.write_bytes(planted)
        with pytest.raises(TactileError, match="materialise"):
            load_unet(directory)
        assert not trace.exists()
        file.write_bytes(whole)


def test_a_table_runs_nothing(planted, trace, tmp_path):
    """As `practice_rays`; PyArrow once unpickled what a file's schema told it to."""
    told = {
        b"ARROW:extension:name": b"arrow.py_extension_type",
        b"ARROW:extension:metadata": planted,
    }
    schema = pa.schema([pa.field("rays", pa.int64(), metadata=told)])
    written = io.BytesIO()
    pq.write_table(pa.table({"rays": [1]}, schema=schema), written)
    assert pq.read_schema(io.BytesIO(written.getvalue())).field("rays").metadata == told
    for data in (planted, written.getvalue()):
        (tmp_path / "practice_rays.parquet").write_bytes(data)
        with pytest.raises(DamagedError, match="materialise practice_rays"):
            read_table(tmp_path / "practice_rays.parquet")
        assert not trace.exists()
    pq.read_table(io.BytesIO(written.getvalue())).to_pandas()  # under a right checksum, too
    assert not trace.exists()


REPOSITORY = Path(__file__).parents[2]
# How files are read here: as data alone, torch's by its restricted loader; and entry points.
READS = {
    "json.loads", "safetensors.torch.load", "torch.load", "further_commands()[name].load",
}  # fmt: skip


def test_nothing_is_read_by_a_loader_that_unpickles():
    """`pickle.load`, `PPO.load`, `np.load`, `pd.read_pickle` and their like."""
    calls = [
        (file.name, ast.unparse(node.func), ast.unparse(node))
        for package in ("tactile_core", "tactile_assets")
        for file in sorted((REPOSITORY / package).rglob("*.py"))
        for node in ast.walk(ast.parse(file.read_bytes()))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)
    ]
    ends = ("load", "loads", "restore", "read_pickle", "Unpickler")
    assert {name for _, name, _ in calls if name.rpartition(".")[2] in ends} <= READS
    torch = [(file, call) for file, name, call in calls if name == "torch.load"]
    assert torch and all(file == "checkpoints.py" for file, _ in torch)
    assert all("weights_only=True" in call for _, call in torch)
