"""OpenGL and the rasteriser give equal pixels. Skipped, platform by platform, without OpenGL."""

import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from upath import UPath

from tactile_core.dataset.meshes import collect_meshes
from tactile_core.dataset.rendering import opengl
from tactile_core.dataset.rendering.camera import project
from tactile_core.dataset.rendering.rasteriser import rasterise
from tactile_core.dataset.rendering.silhouettes import draw
from tactile_core.errors import TactileError
from tactile_core.settings import MaskSettings, MeshSettings

SAMPLE = Path(__file__).resolve().parents[5] / "shared" / "data" / "shapenet_sample"


def choose(platform, monkeypatch):
    """Only this platform is tried, as a user would ask for."""
    monkeypatch.setenv("PYOPENGL_PLATFORM", platform)
    opengl.working_platform.cache_clear()


@pytest.fixture(params=opengl.PLATFORMS)
def platform(request, monkeypatch):
    choose(request.param, monkeypatch)
    yield opengl.working_platform() or pytest.skip(
        f"{request.param} does not work here: install {opengl.DEBIAN_PACKAGES}"
    )
    opengl.working_platform.cache_clear()


@pytest.fixture(scope="module")
def sample(tmp_path_factory):
    """The real meshes, each at rotation 0 and at two random ones."""
    if not SAMPLE.exists():
        pytest.skip(f"{SAMPLE} is not there")
    root = UPath(tmp_path_factory.mktemp("meshes"))
    cache = tmp_path_factory.mktemp("cache")
    meshes = collect_meshes(MeshSettings(location=str(SAMPLE)), root, cache)
    usable = meshes[meshes["status"] == "ok"]
    rotations = np.random.default_rng(0).uniform(0, 360, (3, len(usable)))
    rotations[0] = 0
    return root, pd.concat([usable.assign(rotation=turns, warp=0) for turns in rotations])


def test_both_renderers_give_equal_pixels_on_the_real_sample(platform, sample):
    root, wanted = sample
    assert len(wanted) == 3 * 39
    resolution = 64 if platform == "egl" else 256
    masks = {
        renderer: draw(
            wanted, root, MaskSettings(resolution=resolution, renderer=renderer), workers=1
        )
        for renderer in ("pyrender", "rasteriser")
    }
    assert all(isinstance(mask, bytes) for mask in masks["pyrender"])
    differing = np.flatnonzero(
        [a != b for a, b in zip(masks["pyrender"], masks["rasteriser"], strict=True)]
    )
    assert wanted.iloc[differing]["file"].to_list() == []


def test_both_renderers_agree_on_edges_through_pixel_centres_and_on_slivers(platform):
    """Corners on half pixels, and triangles with two corners a 256th of a pixel apart."""
    random = np.random.default_rng(1)
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=spawn) as process:  # OpenGL stays out of this one
        for resolution in [64] * 60 + [96] * 60:
            # Within the image: OpenGL clips what reaches beyond it, and rounds anew.
            points = random.integers(2, 2 * resolution - 4, (2, 30, 2)) / 2
            points[1, 15:] += random.integers(0, 256, (15, 2)) / 256
            points[1, :15] = points[1, 15:] + random.integers(-1, 2, (15, 2)) / 256
            for corners in points:
                up, right = (corners / resolution * 2 - 1).T
                vertices = np.stack([np.zeros(30), right, up * np.sqrt(2)], axis=1)
                faces = random.integers(0, 30, (3, 3))
                ours = rasterise(project(vertices, 0, resolution), faces, resolution)
                theirs = process.submit(
                    opengl.silhouette, vertices, faces, 0, resolution, platform
                ).result()
                assert np.argwhere(ours != theirs).tolist() == []


def test_a_platform_that_breaks_is_found_out_in_another_process(monkeypatch):
    choose("nonsense", monkeypatch)
    assert opengl.working_platform() is None


def test_asking_for_pyrender_without_opengl_names_the_debian_packages(monkeypatch):
    choose("nonsense", monkeypatch)
    with pytest.raises(
        TactileError, match=r"tried nonsense.*libosmesa6, or libegl1 libgl1-mesa-dri"
    ):
        opengl.required_platform()
