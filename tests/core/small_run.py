"""What a run leaves in its home, made of the small parts that the tests share, without Dagster."""

from pathlib import Path

import pandas as pd
from upath import UPath

from tactile_core.dataset.outlines import trace_outlines
from tactile_core.dataset.rendering.pictures import encode_mask
from tactile_core.dataset.shapes import Shapes
from tactile_core.evaluation.rollouts import cast_rollouts
from tactile_core.exploration.learning.approaches import find_approach
from tactile_core.exploration.learning.train import train_policy
from tactile_core.exploration.policies.index import write_index
from tactile_core.exploration.policies.store import load_policies
from tactile_core.parquet import write_table
from tactile_core.profiles import PROFILES
from tactile_core.reconstruction.trained import TrainedUNet, save_unet
from tactile_core.settings import PolicySettings, RolloutSettings

QUICK = PolicySettings(
    steps_per_stage=64, environments=4, rays_per_rollout=16, batch_size=64, epochs=1,
    gain_iterations=2, gain_states=4, gain_tries=2, gain_updates=1,
)  # fmt: skip
TRAINED = ("diff", "gain", "sequence")  # one of each kind


def small_run(home: Path, shapes: dict[str, Shapes], unet: TrainedUNet) -> None:
    """Splits, outlines, U-Net, three policies, and their rollouts beside three rules."""
    artifacts = UPath(home / "artifacts")
    splits = pd.concat(rows_of(split, some) for split, some in shapes.items())
    write_table(splits, artifacts / "rotated_splits.parquet")
    write_table(trace_outlines(splits), artifacts / "outlines.parquet")
    save_unet(unet, artifacts / "unet")
    places = {approach: artifacts / "policies" / f"{approach}-0" for approach in TRAINED}
    versions = {
        place.name: train_policy(
            find_approach(approach), 0, shapes["train"], unet, QUICK,
            directory=place, work=home / "work" / approach,
        )
        for approach, place in places.items()
    }  # fmt: skip
    write_index(artifacts / "policies", versions)
    policies = load_policies(places.values(), unet.version(), unet.resolution)
    rollouts = cast_rollouts(policies, shapes["test"], unet, rollout_settings(), workers=1)
    write_table(rollouts, artifacts / "rollouts.parquet")


def rollout_settings() -> RolloutSettings:
    """The profile's, with three of the rules."""
    return PROFILES["smoke"].rollouts.model_copy(
        update={"references": ["random", "even", "oracle"]}
    )


def rows_of(split: str, shapes: Shapes) -> pd.DataFrame:
    """The shapes of a split as rows of `rotated_splits`."""
    return pd.DataFrame(
        {
            "split": split,
            "sample_id": shapes.sample_ids,
            "model_id": shapes.model_ids,
            "category": shapes.categories,
            "geometry": shapes.geometries,
            "mask": [encode_mask(mask) for mask in shapes.masks[:]],
        }
    )
