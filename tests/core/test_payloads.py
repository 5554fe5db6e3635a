"""What somebody else put where we read runs no code of theirs."""

import pickle
import zipfile
from pathlib import Path

import pytest
import torch
from upath import UPath

from tactile_core.checkpoints import load_checkpoint
from tactile_core.errors import TactileError
from tactile_core.exploration.learning.approaches import find_approach
from tactile_core.exploration.learning.train import train_policy
from tactile_core.exploration.policies.store import load_policies
from tactile_core.reconstruction.trained import load_unet, save_unet
from tactile_core.settings import PolicySettings

QUICK = PolicySettings(
    steps_per_stage=64, environments=4, rays_per_rollout=16, batch_size=16, epochs=1
)


class Payload:
    """Makes a file when it is unpickled."""

    def __init__(self, trace: Path) -> None:
        self.trace = trace

    def __reduce__(self):
        return Path.touch, (self.trace,)


@pytest.fixture
def trace(tmp_path) -> Path:
    return tmp_path / "payload-ran"


@pytest.fixture
def payload(trace) -> bytes:
    """A pickle that would leave `trace`; it does where one unpickles it."""
    data = pickle.dumps(Payload(trace))
    pickle.loads(data)
    assert trace.exists()
    trace.unlink()
    return data


def test_a_checkpoint_runs_nothing(payload, trace, tmp_path):
    for name, write in {
        "pickle": lambda path: path.write_bytes(payload),
        "torch": lambda path: torch.save({"key": "key", "state": Payload(trace)}, path),
        "in a container": lambda path: torch.save(
            {"key": "key", "state": {"curve": [Payload(trace)]}}, path
        ),
    }.items():
        write(tmp_path / name)
        assert load_checkpoint(tmp_path / name, "key") is None
        assert not trace.exists()


def test_a_policy_runs_nothing(payload, trace, shapes, unet, tmp_path):
    directory = UPath(tmp_path / "total-0")
    train_policy(
        find_approach("total"), 0, shapes["train"], unet, QUICK,
        directory=directory, work=tmp_path / "work",
    )  # fmt: skip
    for file in sorted(tmp_path.joinpath("total-0").iterdir()):
        whole = file.read_bytes()
        file.write_bytes(payload)
        if file.name == "policy.zip":  # for users of Stable-Baselines3, and never read
            with zipfile.ZipFile(file, "w") as archive:
                archive.writestr("data", payload)
            load_policies([directory], unet.version(), 64)
        elif file.name in ("policy.safetensors", "settings.json"):
            with pytest.raises(TactileError, match="materialise policies"):
                load_policies([directory], unet.version(), 64)
        assert not trace.exists()
        file.write_bytes(whole)


def test_a_unet_runs_nothing(payload, trace, unet, tmp_path):
    directory = UPath(tmp_path / "unet")
    save_unet(unet, directory)
    for file in sorted(tmp_path.joinpath("unet").iterdir()):
        whole = file.read_bytes()
        file.write_bytes(payload)
        with pytest.raises(TactileError, match="materialise"):
            load_unet(directory)
        assert not trace.exists()
        file.write_bytes(whole)
