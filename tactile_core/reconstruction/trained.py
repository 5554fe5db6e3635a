"""A trained U-Net as a value, and as files: safetensors weights beside a JSON of settings."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd
import safetensors.torch
import torch
from pydantic import ValidationError
from safetensors import SafetensorError
from torch import Tensor
from upath import UPath

from tactile_core.checksums import sealed_json, unsealed_json
from tactile_core.dataset.packed import PackedMasks
from tactile_core.dataset.shapes import Shapes
from tactile_core.errors import OutOfReachError, TactileError
from tactile_core.files import content_hash, kept_bytes, written_whole
from tactile_core.parquet import read_table, table_hash, write_table
from tactile_core.reconstruction.known_shapes import (
    PACKED_SHAPES,
    KnownShapes,
    models_of,
    rows_of,
    unpack,
)
from tactile_core.reconstruction.unet import UNet
from tactile_core.settings import Settings, UNetSettings, problems

EIGHT_BITS = "eight_bits."  # begins the names of ranges, beside those of weights


@dataclass(frozen=True)
class TrainedUNet:
    """Weights and what made them.

    weights : float32 tensors by name
    settings : the resolved `UNetSettings` as a dict
    scores : eval loss and Jaccard index (0–100) of the kept epoch
    curve : one row per epoch: epoch, train_loss, eval_loss, eval_jaccard
    trained_on : model_id, geometry and split (train or eval) of every model it has seen
    known : the shapes that the net knows, (n, R²/8) uint8 as `known_shapes.pack` packs them
    eight_bits : for convolutions in eight bits the ranges of what they see, as `eight_bits.ranges`
        gives them; empty where they do not pay
    key : that it was trained under, see `keys`
    """

    weights: dict[str, Tensor]
    resolution: int
    depth: int
    channels: int
    settings: dict[str, Any]
    scores: dict[str, float]
    curve: pd.DataFrame = field(repr=False)
    trained_on: pd.DataFrame = field(repr=False)
    known: np.ndarray | None = field(default=None, repr=False)
    key: str = ""
    eight_bits: dict[str, Tensor] = field(default_factory=dict, repr=False)

    @property
    def free_space(self) -> bool:
        """Whether the U-Net was trained to see where rays have passed."""
        return bool(self.settings.get("free_space"))

    def net(self, trained_on: Shapes | None = None) -> UNet:
        """A fresh net in eval mode that holds these weights.

        Given the shapes that it was `trained_on`, it can be told whose known shapes not to recall.
        """
        known = None
        if self.known is not None:
            models = None
            if trained_on is not None:
                models = models_of(self.known, trained_on.packed, trained_on.model_ids)
            known = KnownShapes(unpack(self.known, self.resolution), models)
        net = UNet(self.depth, self.channels, known)
        net.load_state_dict(self.weights)
        return net.eval()

    def version(self) -> str:
        """Hash of all tensors and the resolution (16 hex digits)."""
        return content_hash(safetensors.torch.save(self.tensors()), self.resolution)

    def tensors(self) -> dict[str, Tensor]:
        """What `model.safetensors` holds: weights, the ranges for eight bits, and known shapes."""
        known = {} if self.known is None else {PACKED_SHAPES: torch.from_numpy(self.known)}
        ranges = {EIGHT_BITS + name: value for name, value in self.eight_bits.items()}
        return {**self.weights, **ranges, **known}

    def forgetting(self, masks: PackedMasks) -> "TrainedUNet":
        """This U-Net without `masks` among the shapes that it knows."""
        assert self.known is not None
        forgotten = set(rows_of(masks))
        kept = [row.tobytes() not in forgotten for row in self.known]
        return replace(self, known=self.known[kept])


class StoredUNet(Settings):
    """What a U-Net's files say of it; `version` and `trained_on` are hashes of two of them."""

    resolution: int
    depth: int
    channels: int
    settings: UNetSettings
    scores: dict[str, float]
    version: str
    trained_on: str
    key: str = ""


def save_unet(unet: TrainedUNet, directory: UPath) -> None:
    """Write `model.safetensors`, two tables and, last, `settings.json`."""
    description = StoredUNet(
        resolution=unet.resolution,
        depth=unet.depth,
        channels=unet.channels,
        settings=UNetSettings(**unet.settings),
        scores=unet.scores,
        version=unet.version(),
        trained_on=table_hash(unet.trained_on),
        key=unet.key,
    )
    with written_whole(directory / "model.safetensors") as file:
        file.write(safetensors.torch.save(unet.tensors()))
    write_table(unet.curve, directory / "curve.parquet")
    write_table(unet.trained_on, directory / "trained_on.parquet")
    with written_whole(directory / "settings.json") as file:
        file.write(sealed_json(description))


def load_unet(directory: UPath) -> TrainedUNet:
    """Read what `save_unet` wrote; raises `TactileError` where it is missing or damaged."""
    try:
        description = unsealed_json(kept_bytes(directory / "settings.json"), StoredUNet)
        data = kept_bytes(directory / "model.safetensors")
        if content_hash(data, description.resolution) != description.version:
            raise ValueError("these are not the weights that settings.json tells of")
        weights = safetensors.torch.load(data)
    except FileNotFoundError as error:
        raise TactileError(f"{directory} holds no trained U-Net: materialise unet first") from error
    except OutOfReachError:
        raise
    except (OSError, ValueError, SafetensorError) as error:
        reason = problems(error) if isinstance(error, ValidationError) else error
        raise TactileError(
            f"{directory} is damaged, or its files are of two trainings ({reason}): "
            "materialise unet again"
        ) from error
    known = weights.pop(PACKED_SHAPES, None)
    eight_bits = {
        name.removeprefix(EIGHT_BITS): weights.pop(name)
        for name in list(weights)
        if name.startswith(EIGHT_BITS)
    }
    unet = TrainedUNet(
        weights=weights,
        resolution=description.resolution,
        depth=description.depth,
        channels=description.channels,
        settings=description.settings.model_dump(),
        scores=description.scores,
        curve=read_table(directory / "curve.parquet", "unet"),
        trained_on=read_table(directory / "trained_on.parquet", "unet"),
        known=None if known is None else known.numpy(),
        key=description.key,
        eight_bits=eight_bits,
    )
    if table_hash(unet.trained_on) != description.trained_on:
        raise TactileError(f"{directory}: its files are of two trainings: materialise unet again")
    return unet


def unet_at(directory: UPath) -> TrainedUNet | None:
    """The U-Net that an earlier run left, if there is one and it is whole. Raises `OutOfReachError`
    where that cannot be told: mend the store before anything is trained anew."""
    try:
        return load_unet(directory)
    except OutOfReachError:
        raise
    except TactileError:
        return None
