"""The environments by name: what `gymnasium.make` and `make_vec` call for

    gymnasium.make("tactile_core:TactileExploration-v1")
    gymnasium.make_vec("tactile_core:TactileExploration-v1", num_envs=256)

`tactile_core` registers them.
"""

import inspect
import os
from collections.abc import Sequence
from typing import Any

import numpy as np
from upath import UPath

from tactile_core.dataset.rendering.pictures import decode_masks
from tactile_core.dataset.shapes import SPLITS
from tactile_core.errors import TactileError
from tactile_core.exploration.at_hand import ROTATED_SPLITS, at_hand
from tactile_core.exploration.learning.approaches import find_approach
from tactile_core.exploration.world.env import TactileEnv
from tactile_core.exploration.world.episodes import Options
from tactile_core.exploration.world.interface import Interface
from tactile_core.exploration.world.rewards import Stage
from tactile_core.exploration.world.vec_env import BatchedTactileEnv
from tactile_core.exploration.world.vector_env import TactileVectorEnv
from tactile_core.parquet import read_table
from tactile_core.reconstruction.inference import Reconstructor
from tactile_core.reconstruction.trained import TrainedUNet, load_unet

# Arguments of an environment class that are made out of others here.
GIVEN = {"masks", "reconstructor", "stage", "num_envs", "environments", "options"}

AnyUNet = Reconstructor | TrainedUNet | str | os.PathLike | UPath


def make_env(**arguments: Any) -> TactileEnv:
    """The single environment: `environment_parts` and the arguments of `TactileEnv`."""
    return TactileEnv(**environment_parts(TactileEnv, **arguments))


def make_vector_env(num_envs: int = 1, **arguments: Any) -> TactileVectorEnv:
    """Many at once: `environment_parts` and the arguments of `TactileVectorEnv`."""
    return TactileVectorEnv(num_envs, **environment_parts(TactileVectorEnv, **arguments))


def make_sb3_env(environments: int = 32, **arguments: Any) -> BatchedTactileEnv:
    """Many at once for Stable-Baselines3: `environment_parts` and those of `BatchedTactileEnv`."""
    return BatchedTactileEnv(environments, **environment_parts(BatchedTactileEnv, **arguments))


def environment_parts(
    environment: type,
    *,
    masks: np.ndarray | None = None,
    unet: AnyUNet | None = None,
    split: str | None = None,
    approach: str | Stage = "diff",
    stage: int | Stage | None = None,
    actions: Any = None,
    channels: Sequence[Any] | None = None,
    interface: Interface | None = None,
    **others: Any,
) -> dict[str, Any]:
    """The arguments of an environment class out of those that are friendlier to give.

    masks : (M, R, R) of 0 and 1, in the middle half of the image; by default those of `split`
        ("train", "eval" or, by default, "test") that the last run stored in the home or, without a
        run, that the package ships
    unet : the U-Net that reconstructs, or where it is stored; by default that of the same run
    approach, stage : whose reward and end, see `learning.approaches`: an approach by name with the
        number of its stage, by default the first, or one stage of your own
    actions, channels : see `Interface`, which may be given as a whole instead

    Raises `TactileError` where one of them is unknown or not there, or two say different things.
    """
    own = inspect.signature(environment).parameters.keys() | Options.__annotations__.keys()
    if unknown := others.keys() - own:
        raise TactileError(
            f"an environment knows no {min(unknown)}=: there are masks, unet, split, approach, "
            f"stage, actions, channels and {', '.join(sorted(own - GIVEN))}"
        )
    if masks is not None and split is not None:
        raise TactileError(f"masks= are given, so there is no split={split!r} to take: give one")
    return {
        "masks": default_masks(split or "test") if masks is None else masks,
        "reconstructor": as_reconstructor(default_unet() if unet is None else unet),
        "stage": find_stage(approach, stage),
        "interface": find_interface(actions, channels, interface),
        **others,
    }


def find_interface(
    actions: Any, channels: Sequence[Any] | None, interface: Interface | None
) -> Interface:
    """The interface, whole or by its parts."""
    parts = {"actions": actions, "channels": channels}
    given = {name: part for name, part in parts.items() if part is not None}
    if interface is None:
        return Interface(**given)
    if given:
        raise TactileError("interface= has actions and channels: give these or that")
    return interface


def find_stage(approach: str | Stage, stage: int | Stage | None) -> Stage:
    """The stage of one's own, or that of an approach."""
    if isinstance(approach, Stage):
        if stage is not None:
            raise TactileError("approach= is a stage already: there is no stage= to choose from it")
        return approach
    return stage if isinstance(stage, Stage) else stage_of(approach, 1 if stage is None else stage)


def stage_of(approach: str, number: int) -> Stage:
    """Stage `number` (from 1) of an approach; raises `TactileError` where there is none."""
    stages = find_approach(approach).stages
    if not stages:
        raise TactileError(f"approach {approach!r} has no reward: it learns the gains of rays")
    if number not in range(1, len(stages) + 1):
        raise TactileError(f"approach {approach!r} has stages 1 to {len(stages)}, not {number}")
    return stages[number - 1]


def as_reconstructor(unet: AnyUNet) -> Reconstructor:
    """Ready to predict, from wherever it is."""
    if isinstance(unet, Reconstructor):
        return unet
    return Reconstructor(unet if isinstance(unet, TrainedUNet) else load_unet(UPath(unet)))


def default_masks(split: str) -> np.ndarray:
    """The masks of a split, (M, R, R) bool, that are `at_hand`."""
    if split not in SPLITS:
        raise TactileError(f"split={split!r} is unknown: choose from {', '.join(SPLITS)}")
    table = read_table(at_hand() / ROTATED_SPLITS)
    rows = table[table["split"] == split]
    if rows.empty:
        raise TactileError(f"the {split} split is empty: rotated_splits has too few models")
    return decode_masks(rows["mask"])


def default_unet() -> UPath:
    """Where the U-Net lies that is `at_hand`."""
    return at_hand() / "unet"
