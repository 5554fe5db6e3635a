"""Small real parts that many tests share: generated mugs and bottles, a U-Net trained on them."""

from pathlib import Path

import pytest
import torch
from upath import UPath

from tactile_core.cluster import ready_token
from tactile_core.dataset.meshes import collect_meshes
from tactile_core.dataset.outlines import trace_outlines
from tactile_core.dataset.rendering.silhouettes import render_masks
from tactile_core.dataset.shapes import SPLITS, Shapes, load_shapes
from tactile_core.dataset.splits import rotate_splits
from tactile_core.exploration.practice.ray_touches import rays_and_outlines
from tactile_core.reconstruction.inference import Reconstructor
from tactile_core.reconstruction.trained import TrainedUNet
from tactile_core.reconstruction.training import train_unet
from tactile_core.settings import MaskSettings, MeshSettings, SplitSettings, UNetSettings
from tests.core.small_run import small_run
from tests.shared import once, shared_folder


@pytest.fixture(scope="session")
def ray_token(tmp_path_factory) -> Path:
    """The one secret of all Rays that a test process starts: a process reads it once."""
    return ready_token(tmp_path_factory.mktemp("home") / "ray-token")


# Nets this small gain nothing from a second thread, and on a busy machine wait for it.
torch.set_num_threads(1)

SMALL = {"learning_rate": 1e-2, "batch_size": 4, "depth": 3, "channels": 4}


def shapes_of(folder: Path, resolution: int) -> dict[str, Shapes]:
    """Ten mugs and ten bottles, twice each, by the chain that the assets run."""
    root = UPath(folder)
    meshes = MeshSettings(procedural_models={"mug": 10, "bottle": 10})
    manifest = collect_meshes(meshes, root, folder / "cache")
    drawing = MaskSettings(resolution=resolution, renderer="rasteriser")
    masks = render_masks(manifest, root, drawing, workers=1)
    dealing = SplitSettings(rotations=2, eval_share=0.2, test_share=0.2)
    rotated = rotate_splits(masks, manifest, root, drawing, dealing, workers=1)
    outlines = trace_outlines(rotated)
    return {split: load_shapes(rotated, outlines, split) for split in SPLITS}


@pytest.fixture(scope="session")
def shapes(tmp_path_factory) -> dict[str, Shapes]:
    """Train (24 masks), eval (8) and test (8) shapes at resolution 64."""
    return once(
        tmp_path_factory, "shapes", lambda: shapes_of(tmp_path_factory.mktemp("meshes"), 64)
    )


@pytest.fixture(scope="session")
def small_shapes(tmp_path_factory) -> dict[str, Shapes]:
    """The same shapes at the lowest resolution, 48."""
    return once(tmp_path_factory, "small", lambda: shapes_of(tmp_path_factory.mktemp("meshes"), 48))


@pytest.fixture(scope="session")
def unet(shapes, tmp_path_factory) -> TrainedUNet:
    """A small U-Net, trained for a few seconds on the train shapes."""

    def train() -> TrainedUNet:
        return train_unet(
            shapes["train"],
            shapes["eval"],
            UNetSettings(**SMALL, epochs=40, patience=40),
            work=tmp_path_factory.mktemp("unet"),
        )

    return once(tmp_path_factory, "unet", train)


@pytest.fixture(scope="session")
def reconstructor(unet, tmp_path_factory) -> Reconstructor:
    """The U-Net in float32, whose predictions do not hang on what else is in the batch."""

    def make() -> Reconstructor:
        made = Reconstructor(unet, precision="float32")
        assert made.untouched.any() and made.single_touches is not None  # kept from now on
        return made

    return once(tmp_path_factory, "reconstructor", make)


@pytest.fixture(scope="session")
def free_space_reconstructor(shapes, tmp_path_factory) -> Reconstructor:
    """A U-Net that also sees where rays have passed, in float32."""

    def train() -> TrainedUNet:
        return train_unet(
            shapes["train"],
            shapes["eval"],
            UNetSettings(**SMALL, epochs=40, patience=40, free_space=True),
            work=tmp_path_factory.mktemp("unet"),
            touches=rays_and_outlines(shapes["train"], seed=0, free_space=True),
        )

    return Reconstructor(once(tmp_path_factory, "free_space_unet", train), precision="float32")


@pytest.fixture(scope="session")
def knowing_unet(shapes, tmp_path_factory) -> TrainedUNet:
    """A U-Net that knows the train shapes, trained for a few epochs."""

    def train() -> TrainedUNet:
        return train_unet(
            shapes["train"],
            shapes["eval"],
            UNetSettings(**SMALL, epochs=8, known_shapes=True),
            work=tmp_path_factory.mktemp("unet"),
        )

    return once(tmp_path_factory, "knowing_unet", train)


@pytest.fixture(scope="session", params=["reconstructor", "free_space_reconstructor"])
def either_reconstructor(request) -> Reconstructor:
    """One after the other: a U-Net that sees touches only, and one that sees free space too."""
    return request.getfixturevalue(request.param)


@pytest.fixture(scope="session")
def home(tmp_path_factory, shapes, unet) -> Path:
    """A home with what a run leaves there, see `small_run`; not to be changed."""

    folder = shared_folder(tmp_path_factory) / "small_run"

    def run() -> None:
        small_run(folder, shapes, unet)

    once(tmp_path_factory, "small_run_made", run)
    return folder
