"""Trained policies as files: the one place that writes and reads them.

A policy is a directory: `policy.safetensors`, `curve.parquet`, `trained_on.parquet` (the train
models) and, last, `settings.json`, which says what the others are. Beside those of PPO lies
`policy.zip` for users of Stable-Baselines3; it is a pickle, and never read back.
"""

from collections.abc import Iterable, Mapping
from typing import Literal

import pandas as pd
import safetensors.torch
from pydantic import ValidationError
from safetensors import SafetensorError
from torch import Tensor
from upath import UPath

from tactile_core.checksums import sealed_json, unsealed_json
from tactile_core.errors import OutOfReachError, TactileError
from tactile_core.exploration.policies.base import Policy
from tactile_core.exploration.policies.ppo import PPOPolicy, net_with
from tactile_core.exploration.policies.recall import RecallPolicy, load_known_shapes
from tactile_core.exploration.policies.scorer import RayScorer, ScorerPolicy
from tactile_core.exploration.policies.sequence import SequencePolicy
from tactile_core.exploration.world.circle import circle_pixels
from tactile_core.files import content_hash, kept_bytes, written_whole
from tactile_core.parquet import read_table, table_hash, write_table
from tactile_core.reconstruction.inference import best_device
from tactile_core.reconstruction.known_shapes import PACKED_SHAPES
from tactile_core.settings import PolicySettings, Settings, problems

WEIGHTS, CURVE, DESCRIPTION = "policy.safetensors", "curve.parquet", "settings.json"
TRAINED_ON = "trained_on.parquet"
FOR_SB3 = "policy.zip"
RAYS_OF_SEQUENCE = "rays"  # its one tensor


class StoredPolicy(Settings):
    """What a policy's files say of it.

    key : that it was trained under, see `keys`; unet : version of the U-Net that it was trained
    with; version, trained_on : hashes of its weights and of the table of its train models
    """

    approach: str
    learner: Literal["ppo", "gains", "sequence"]
    seed: int
    settings: PolicySettings
    resolution: int
    unet: str
    key: str
    version: str
    trained_on: str

    @property
    def name(self) -> str:
        """Of its directory."""
        return f"{self.approach}-{self.seed}"

    @property
    def policies(self) -> list[str]:
        """Names of the policies that it holds; a ray scorer brings a recall of its own."""
        if self.learner != "gains":
            return [self.approach]
        return [self.approach, "recall" if self.approach == "gain" else f"recall_{self.approach}"]


def save_policy(
    directory: UPath,
    description: StoredPolicy,
    tensors: Mapping[str, Tensor],
    curve: pd.DataFrame,
    trained_on: pd.DataFrame,
) -> None:
    """Write weights, training curve, train models and, last, the description."""
    with written_whole(directory / WEIGHTS) as file:
        file.write(safetensors.torch.save(dict(tensors)))
    write_table(curve, directory / CURVE)
    write_table(trained_on, directory / TRAINED_ON)
    with written_whole(directory / DESCRIPTION) as file:
        file.write(sealed_json(description))


def describe(directory: UPath) -> StoredPolicy:
    """What is stored in `directory`; raises `TactileError` where it is missing or damaged."""
    try:
        return unsealed_json(kept_bytes(directory / DESCRIPTION), StoredPolicy)
    except FileNotFoundError as error:
        raise TactileError(f"{directory} holds no policy: materialise policies first") from error
    except ValidationError as error:
        raise damaged(directory, problems(error)) from error
    except OutOfReachError:
        raise
    except (OSError, ValueError) as error:
        raise damaged(directory, f"{DESCRIPTION} {error}") from error


def read_weights(directory: UPath, description: StoredPolicy) -> dict[str, Tensor]:
    """The tensors that `description` speaks of; raises `TactileError` where they are others."""
    try:
        data = kept_bytes(directory / WEIGHTS)
        if content_hash(data) != description.version:
            raise ValueError("or its weights and settings are of two trainings")
        return safetensors.torch.load(data)
    except FileNotFoundError as error:
        raise TactileError(f"{directory} holds no policy: materialise policies first") from error
    except OutOfReachError:
        raise
    except (OSError, ValueError, SafetensorError) as error:
        raise damaged(directory, str(error)) from error


def trained_on(directories: Iterable[UPath]) -> dict[str, pd.DataFrame]:
    """The model_id and geometry of the train models of each stored policy, by its name.

    Raises `TactileError` where a table is missing, damaged or another policy's.
    """
    tables = {}
    for directory in directories:
        table = read_table(directory / TRAINED_ON, "policies")
        if table_hash(table) != describe(directory).trained_on:
            raise damaged(directory, f"{TRAINED_ON} is another policy's")
        tables[f"policy {directory.name}"] = table
    return tables


def load_policies(directories: Iterable[UPath], unet: str, resolution: int) -> list[Policy]:
    """The policies stored in each of `directories`: the trained one and, where that is a ray
    scorer, `recall` as well, which needs no training of its own.

    unet, resolution : version and resolution of the U-Net that they are to be used with

    Raises `TactileError` where one is missing, damaged or trained with another U-Net.
    """
    return [
        policy for directory in directories for policy in stored_in(directory, unet, resolution)
    ]


def stored_in(directory: UPath, unet: str, resolution: int) -> list[Policy]:
    description = describe(directory)
    if description.resolution != resolution:
        raise TactileError(
            f"{directory} was trained at resolution {description.resolution}, the U-Net is at "
            f"{resolution}: materialise policies again"
        )
    if description.unet != unet:
        raise TactileError(
            f"{directory} was trained with another U-Net than the one that is stored: materialise "
            "policies again"
        )
    tensors = read_weights(directory, description)
    load = {"ppo": ppo_policies, "gains": scorer_policies, "sequence": sequence_policies}[
        description.learner
    ]
    try:
        return load(description, tensors)
    except (KeyError, RuntimeError) as error:  # tensors of other names or shapes
        raise damaged(directory, str(error).splitlines()[0]) from error


def scorer_policies(description: StoredPolicy, tensors: dict[str, Tensor]) -> list[Policy]:
    packed = tensors.pop(PACKED_SHAPES).numpy().tobytes()
    known = load_known_shapes(packed, description.resolution)
    net = RayScorer().to(best_device()).eval()
    net.load_state_dict(tensors)
    approach, recall = description.policies
    seed = description.seed
    return [ScorerPolicy(approach, seed, net), RecallPolicy(recall, seed, net, known)]


def ppo_policies(description: StoredPolicy, tensors: dict[str, Tensor]) -> list[Policy]:
    net = net_with(tensors, description.resolution).to(best_device())
    return [PPOPolicy(description.approach, description.seed, net)]


def sequence_policies(description: StoredPolicy, tensors: dict[str, Tensor]) -> list[Policy]:
    rays = tensors[RAYS_OF_SEQUENCE].numpy()
    pixels = len(circle_pixels(description.resolution))
    if rays.ndim != 2 or rays.shape[1] != 2 or not 0 <= rays.min() <= rays.max() < pixels:
        raise KeyError("these are not rays of this resolution")
    return [SequencePolicy(description.approach, description.seed, rays)]


def damaged(directory: UPath, reason: str) -> TactileError:
    return TactileError(f"{directory} is damaged ({reason}): materialise policies again")
