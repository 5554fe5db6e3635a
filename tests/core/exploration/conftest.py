"""A home in which a run has left all that environments and policies are made of."""

from pathlib import Path

import pandas as pd
import pytest
from upath import UPath

from tactile_core.dataset.rendering.pictures import encode_mask
from tactile_core.exploration.learning.approaches import find_approach
from tactile_core.exploration.learning.train import train_policy
from tactile_core.exploration.policies.index import write_index
from tactile_core.files import write_table
from tactile_core.reconstruction.trained import save_unet
from tactile_core.settings import PolicySettings
from tests.shared import once

QUICK = PolicySettings(
    steps_per_stage=64, environments=4, rays_per_rollout=16, batch_size=64, epochs=1,
    gain_iterations=2, gain_states=4, gain_tries=2, gain_updates=1,
)  # fmt: skip
TRAINED = ("diff", "gain", "sequence")  # one of each kind


@pytest.fixture(scope="session")
def home(tmp_path_factory, shapes, unet) -> Path:
    """With splits, a U-Net and three policies; not to be changed."""

    def run() -> Path:
        folder = tmp_path_factory.mktemp("home")
        artifacts = UPath(folder / "artifacts")
        rows = [(split, encode_mask(mask)) for split, some in shapes.items() for mask in some.masks]
        write_table(
            pd.DataFrame(rows, columns=["split", "mask"]), artifacts / "rotated_splits.parquet"
        )
        save_unet(unet, artifacts / "unet")
        versions = {
            f"{approach}-0": train_policy(
                find_approach(approach), 0, shapes["train"], unet, QUICK,
                directory=artifacts / "policies" / f"{approach}-0", work=folder / "work" / approach,
            )
            for approach in TRAINED
        }  # fmt: skip
        write_index(artifacts / "policies", versions)
        return folder

    return once(tmp_path_factory, "explored_home", run)
