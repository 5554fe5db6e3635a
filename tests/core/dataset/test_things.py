"""What can be felt out is named by a path or a class."""

import os

import numpy as np
import pytest
from PIL import Image, ImageDraw

from tactile_core.dataset.geometry import geometry_hash
from tactile_core.dataset.procedural.models import GENERATORS, obj_bytes, procedural_models
from tactile_core.dataset.sources.parsing import parse_mesh
from tactile_core.dataset.things import find_thing, generated_thing
from tactile_core.errors import TactileError
from tactile_core.settings import MeshSettings


@pytest.mark.parametrize("category", GENERATORS)
def test_a_generated_shape_follows_its_seed_and_is_no_model_of_any_dataset(category):
    one, same, other = (generated_thing(category, 64, seed) for seed in (0, 0, 1))
    np.testing.assert_array_equal(one.mask, same.mask)
    assert (one.mask != other.mask).any()
    meshes = MeshSettings(classes={category: category}, procedural_models={category: 60})
    models = [build() for _, _, build in procedural_models(meshes)]
    assert one.geometry not in {geometry_hash(mesh.vertices, mesh.faces) for mesh in models}
    assert one.said.startswith(f"a generated {category} (seed 0), turned by ")


def test_a_mesh_is_felt_as_the_masks_of_the_platform_are_drawn(tmp_path, shapes):
    meshes = MeshSettings(procedural_models={"mug": 1, "bottle": 0})
    ((_, model, build),) = procedural_models(meshes)
    (tmp_path / "my mug.obj").write_bytes(obj_bytes(build()))
    thing = find_thing(str(tmp_path / "my mug.obj"), 64)
    mesh = parse_mesh(obj_bytes(build()), ".obj")
    assert thing.said == f"a mesh of {len(mesh.faces)} faces"
    known = {g for some in shapes.values() for g in some.geometries}
    assert thing.geometry in known and model in {
        m for some in shapes.values() for m in some.model_ids
    }


def test_a_picture_is_found_by_its_ending_in_any_case(tmp_path):
    picture = Image.new("L", (90, 90), 255)
    ImageDraw.Draw(picture).ellipse([20, 20, 60, 60], fill=0)
    picture.save(tmp_path / "disc.PNG")
    assert find_thing(str(tmp_path / "disc.PNG"), 64).mask.sum() > 300


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        (
            "cup",
            None,
            r"cup is not there: give a mesh \(.obj .* a picture \(.png .* \(mug bottle\)",
        ),
        (".", None, "is a folder: name one mesh or picture in it"),
        ("notes.txt", b"hello", r"notes.txt is neither a mesh .* nor a picture"),
        ("broken.obj", b"v 0 0", "broken.obj has no faces"),
        ("page.stl", b"<!doctype html>", "page.stl is a web page, not a mesh"),
        ("broken.png", b"PNG?", "broken.png is no picture"),
        ("flat.obj", b"v 0 0 0\nv 1 0 1\nv 2 0 2\nv 0 1 0\nf 1 2 3\n", "flat.obj "),
    ],
)
def test_what_cannot_be_felt_is_named_with_the_reason(tmp_path, monkeypatch, name, content, said):
    monkeypatch.chdir(tmp_path)
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(TactileError, match=said) as refused:
        find_thing(name, 64)
    assert "\n" not in str(refused.value)


def test_a_pipe_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe.png")
    with pytest.raises(TactileError, match="is no file: name a mesh or picture"):
        find_thing(str(tmp_path / "pipe.png"), 64)
