"""What is measured on: generated mugs and bottles, and U-Nets with random weights.

How long a U-Net takes does not depend on its weights, so only `precision` needs a trained one.
"""

import functools

import numpy as np
import pandas as pd
import torch
import trimesh

from tactile_core.dataset.outlines import outline
from tactile_core.dataset.packed import pack_masks
from tactile_core.dataset.procedural.models import procedural_models
from tactile_core.dataset.rendering.camera import project
from tactile_core.dataset.rendering.rasteriser import rasterise
from tactile_core.dataset.shapes import Shapes
from tactile_core.reconstruction.batches import felt_outlines
from tactile_core.reconstruction.eight_bits import with_eight_bits
from tactile_core.reconstruction.trained import TrainedUNet
from tactile_core.reconstruction.unet import UNet
from tactile_core.settings import MeshSettings

RESOLUTION, DEPTH, CHANNELS = 64, 4, 16


@functools.cache
def meshes(each: int = 8) -> list[trimesh.Trimesh]:
    """So many generated mugs and as many bottles."""
    settings = MeshSettings(procedural_models={"mug": each, "bottle": each})
    return [build() for _, _, build in procedural_models(settings)]


@functools.cache
def masks(resolution: int = RESOLUTION) -> np.ndarray:
    """Each of `meshes` at four rotations, (N, R, R) bool."""
    drawn = [
        rasterise(project(mesh.vertices, rotation, resolution), mesh.faces, resolution)
        for mesh in meshes()
        for rotation in (0, 75, 190, 305)
    ]
    return np.stack(drawn)


def shapes(all_masks: np.ndarray) -> Shapes:
    """Masks with their outlines."""
    names = np.array([f"mesh-{number}" for number in range(len(all_masks))])
    outlines = [outline(mask) for mask in all_masks]
    return Shapes(pack_masks(all_masks), outlines, names, names, names, names)


@functools.cache
def untrained(resolution: int = RESOLUTION) -> TrainedUNet:
    """A U-Net of the laptop's size with random weights."""
    torch.manual_seed(0)
    some = shapes(masks(resolution))
    return as_trained(UNet(DEPTH, CHANNELS), some)


def as_trained(net: UNet, some: Shapes) -> TrainedUNet:
    """A net that was trained on these shapes, as the value that a `Reconstructor` is made from."""
    weights = {name: value.cpu().contiguous() for name, value in net.state_dict().items()}
    nothing = pd.DataFrame()
    unet = TrainedUNet(weights, some.resolution, DEPTH, CHANNELS, {"seed": 0}, {}, nothing, nothing)
    return with_eight_bits(unet, some, felt_outlines(some))
