import numpy as np
import pandas as pd
import pytest
import trimesh
from upath import UPath

from tactile_core.dataset.rendering import opengl
from tactile_core.dataset.rendering.camera import project
from tactile_core.dataset.rendering.pictures import decode_masks
from tactile_core.dataset.rendering.rasteriser import rasterise
from tactile_core.dataset.rendering.silhouettes import EMPTY, render_masks
from tactile_core.dataset.sources.parsing import load_mesh
from tactile_core.errors import TactileError
from tactile_core.files import content_hash
from tactile_core.parquet import read_table, table_hash, write_table
from tactile_core.settings import MaskSettings

SETTINGS = MaskSettings(resolution=64, renderer="rasteriser")
# Seen by the report's camera from its very edge: no pixel.
SHEET = "v 0 -0.5 0\nv 0 0.5 0\nv 0.1 0 0.1\nf 1 2 3\n"


def write_meshes(root, count=6):
    """`count` boxes and balls under `root`, and their manifest."""
    random = np.random.default_rng(0)
    rows = []
    for number in range(count):
        if number % 2:
            mesh = trimesh.creation.box(extents=random.uniform(0.2, 1, 3))
        else:
            mesh = trimesh.creation.icosphere(subdivisions=2)
        file = f"0/{number}/model.obj"
        (root / file).parent.mkdir(parents=True, exist_ok=True)
        (root / file).write_text(mesh.export(file_type="obj"))
        rows.append(row(root, file, f"m{number}"))
    return pd.DataFrame(rows)


def row(root, file, model_id, status="ok"):
    return {
        "model_id": model_id,
        "category": "mug",
        "file": file,
        "content_hash": content_hash((root / file).read_bytes()),
        "geometry": f"geometry of {model_id}",
        "status": status,
    }


def added(meshes, root, model_id, text, status="ok"):
    """The manifest with one more mesh, whose file holds `text`."""
    (root / f"{model_id}.obj").write_text(text)
    return pd.concat([meshes, pd.DataFrame([row(root, f"{model_id}.obj", model_id, status)])])


@pytest.fixture
def root(tmp_path):
    return UPath(tmp_path)


@pytest.fixture
def without_opengl(monkeypatch):
    monkeypatch.setenv("PYOPENGL_PLATFORM", "nonsense")
    opengl.working_platform.cache_clear()
    yield
    opengl.working_platform.cache_clear()


def test_every_usable_mesh_gets_the_mask_of_its_geometry(root):
    meshes = write_meshes(root)
    masks = render_masks(meshes, root, SETTINGS)
    assert list(masks) == [
        "model_id", "category", "content_hash", "geometry", "resolution", "status", "mask",
        "key",
    ]  # fmt: skip
    assert masks["model_id"].tolist() == meshes["model_id"].tolist()
    assert set(masks["status"]) == {"ok"}
    for file, mask in zip(meshes["file"], decode_masks(masks["mask"]), strict=True):
        mesh = load_mesh(root, file)
        points = project(mesh.vertices, 0, 64)
        assert (mask == rasterise(points, mesh.faces, 64)).all()
        assert mask.any()


def test_masks_survive_storage(root, tmp_path):
    masks = render_masks(added(write_meshes(root), root, "sheet", SHEET), root, SETTINGS)
    write_table(masks, tmp_path / "masks.parquet")
    assert table_hash(read_table(tmp_path / "masks.parquet")) == table_hash(masks)


def test_masks_do_not_depend_on_the_number_of_processes(root):
    meshes = write_meshes(root, 12)
    alone = render_masks(meshes, root, SETTINGS, workers=1)
    assert table_hash(alone) == table_hash(render_masks(meshes, root, SETTINGS, workers=2))


def test_meshes_set_aside_before_are_left_out(root):
    meshes = added(write_meshes(root), root, "broken", "", status="has no faces")
    assert "broken" not in set(render_masks(meshes, root, SETTINGS)["model_id"])


@pytest.mark.parametrize("workers", [1, 2])
def test_a_mesh_without_a_silhouette_or_without_faces_is_set_aside(root, workers):
    meshes = added(write_meshes(root), root, "sheet", SHEET)
    meshes = added(meshes, root, "faceless", "v 0 0 0\n")
    masks = render_masks(meshes, root, SETTINGS, workers=workers).set_index("model_id")
    assert masks.loc["sheet", "status"] == EMPTY
    assert masks.loc["faceless", "status"].startswith("faceless.obj has no faces")
    assert masks["mask"].isna().sum() == 2
    assert (masks["status"] == "ok").sum() == 6


def test_unchanged_meshes_are_not_even_loaded_again(root):
    meshes = write_meshes(root)
    first = render_masks(meshes, root, SETTINGS)
    changed = meshes["model_id"] == "m3"
    for file in meshes.loc[~changed, "file"]:
        (root / file).unlink()
    (root / "0/3/model.obj").write_text((root / "0/3/model.obj").read_text() + "# said anew\n")
    anew = content_hash((root / "0/3/model.obj").read_bytes())
    newer = meshes.assign(content_hash=meshes["content_hash"].mask(changed, anew))
    messages = []
    second = render_masks(newer, root, SETTINGS, first, messages.append)
    assert set(second["status"]) == {"ok"}
    assert messages[-1] == "1 masks rendered, 5 unchanged"
    assert second["mask"].tolist() == first["mask"].tolist()


@pytest.mark.parametrize("workers", [1, 2])
def test_a_mesh_file_that_was_altered_since_it_was_collected_is_named(root, workers):
    meshes = write_meshes(root)
    altered = root / "0/3/model.obj"
    altered.write_text(trimesh.creation.box().export(file_type="obj"))
    with pytest.raises(TactileError, match=r"0/3/model.obj has changed since .* shapenet_meshes"):
        render_masks(meshes, root, SETTINGS, workers=workers)


def test_another_resolution_or_a_mesh_set_aside_is_rendered_again(root):
    meshes = added(write_meshes(root, 2), root, "broken", "")
    first = render_masks(meshes, root, SETTINGS)
    (root / "broken.obj").write_text(trimesh.creation.box().export(file_type="obj"))
    mended = row(root, "broken.obj", "broken")
    meshes = pd.concat([meshes[meshes["model_id"] != "broken"], pd.DataFrame([mended])])
    second = render_masks(meshes, root, SETTINGS, first)
    assert (second["status"] == "ok").all()
    larger = render_masks(meshes, root, MaskSettings(resolution=96, renderer="rasteriser"), second)
    assert decode_masks(larger["mask"]).shape == (3, 96, 96)
    assert set(larger["resolution"]) == {96}


def test_without_a_single_mask_the_reason_is_told(root):
    with pytest.raises(TactileError, match=f"no mesh gives a mask: {EMPTY}"):
        render_masks(added(pd.DataFrame(), root, "sheet", SHEET), root, SETTINGS)


def test_without_opengl_the_rasteriser_serves_and_says_so_once(root, without_opengl):
    meshes = write_meshes(root)
    messages = []
    masks = render_masks(meshes, root, MaskSettings(resolution=64), None, messages.append)
    assert table_hash(masks) == table_hash(render_masks(meshes, root, SETTINGS))
    assert sum("no OpenGL here" in message for message in messages) == 1


def test_pyrender_without_opengl_is_refused(root, without_opengl):
    settings = MaskSettings(resolution=64, renderer="pyrender")
    with pytest.raises(TactileError, match="install the Debian packages libosmesa6"):
        render_masks(write_meshes(root), root, settings)
