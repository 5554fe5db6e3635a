"""One object under several names is one object, and stands in one split."""

import numpy as np
import pandas as pd
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from upath import UPath

from tactile_core.dataset.copies import find_copies
from tactile_core.dataset.geometry import geometry_hash
from tactile_core.dataset.meshes import collect_meshes
from tactile_core.dataset.procedural.models import GENERATORS
from tactile_core.dataset.rendering.pictures import encode_mask
from tactile_core.dataset.rendering.silhouettes import render_masks
from tactile_core.dataset.sources.parsing import parse_mesh
from tactile_core.dataset.splits import split_models
from tactile_core.errors import TactileError
from tactile_core.settings import MaskSettings, MeshSettings, SplitSettings

SETTINGS = MaskSettings(resolution=64, renderer="rasteriser")
seeds = st.integers(0, 2**31 - 1)


def made(seed: int) -> trimesh.Trimesh:
    """A generated mug or bottle."""
    rng = np.random.default_rng(seed)
    return GENERATORS["mug" if seed % 2 else "bottle"](rng)


def hash_of(mesh: trimesh.Trimesh, file_type: str = "obj") -> str:
    data = mesh.export(file_type=file_type)
    parsed = parse_mesh(data.encode() if isinstance(data, str) else data, f".{file_type}")
    return geometry_hash(parsed.vertices, parsed.faces)


def rewritten(mesh: trimesh.Trimesh, rng: np.random.Generator) -> trimesh.Trimesh:
    """The same surface: vertices and faces in another order, wound and begun otherwise."""
    order = rng.permutation(len(mesh.vertices))
    faces = np.argsort(order)[mesh.faces][rng.permutation(len(mesh.faces))]
    turn = rng.integers(3, size=len(faces))
    faces = faces[np.arange(len(faces))[:, None], (np.arange(3) + turn[:, None]) % 3]
    wound = rng.random(len(faces)) < 0.5
    faces[wound] = faces[wound][:, ::-1]
    return trimesh.Trimesh(mesh.vertices[order], faces, process=False)


@settings(deadline=None, max_examples=20)
@given(seed=seeds)
def test_an_object_has_one_geometry_however_its_file_is_written(seed):
    mesh, rng = made(seed), np.random.default_rng(seed)
    expected = geometry_hash(*parse_parts(mesh))
    assert geometry_hash(*parse_parts(rewritten(mesh, rng))) == expected


@settings(deadline=None, max_examples=20)
@given(seed=seeds)
def test_an_object_that_stands_otherwise_or_has_its_faces_twice_is_the_same(seed):
    """As where another axis points up, in a mirror, and where both sides of a face are stored."""
    mesh = made(seed)
    expected = geometry_hash(*parse_parts(mesh))
    turns = np.eye(3)[[2, 0, 1]], np.diag([1, -1, -1]), np.diag([-1, 1, 1])
    for turn in turns:
        turned = trimesh.Trimesh(mesh.vertices @ turn, mesh.faces, process=False)
        assert geometry_hash(*parse_parts(turned)) == expected
    both = np.concatenate([mesh.faces, mesh.faces[:, ::-1]])
    doubled = trimesh.Trimesh(mesh.vertices, both, process=False)
    assert geometry_hash(*parse_parts(doubled)) == expected


def parse_parts(mesh: trimesh.Trimesh) -> tuple[np.ndarray, np.ndarray]:
    low, high = mesh.bounds
    scaled = (mesh.vertices - (low + high) / 2) / np.linalg.norm(high - low)
    return scaled, mesh.faces


def test_different_objects_have_different_geometries():
    hashes = [geometry_hash(*parse_parts(made(seed))) for seed in range(100)]
    assert len(set(hashes)) == 100


def test_a_polygon_has_the_geometry_of_its_triangles_wherever_they_are_cut():
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]]) / 2**0.5
    one, other = np.array([[0, 1, 2], [0, 2, 3]]), np.array([[1, 2, 3], [1, 3, 0]])
    assert geometry_hash(square, one) == geometry_hash(square, other)


def table(hashes="", geometries="", masks=None) -> pd.DataFrame:
    count = max(len(hashes), len(geometries), len(masks or []))
    return pd.DataFrame(
        {
            "model_id": [f"m{number}" for number in range(count)],
            "content_hash": list(hashes) or [f"h{number}" for number in range(count)],
            "geometry": list(geometries) or [f"g{number}" for number in range(count)],
            "mask": pd.Series(masks or [None] * count, dtype=object),
        }
    )


def test_copies_are_known_by_bytes_or_geometry_and_copies_of_copies_too():
    assert find_copies(table("aabcd", "vwwxy")).tolist() == ["m0", "m0", "m0", "m3", "m4"]


@settings(deadline=None, max_examples=30)
@given(flips=st.lists(st.integers(0, 4), min_size=2, max_size=6), seed=seeds)
def test_silhouettes_are_copies_where_few_pixels_differ(flips, seed):
    """Few beside all that are covered: of 1024, four are, and twenty are not."""
    rng = np.random.default_rng(seed)
    base = np.zeros((64, 64), bool)
    base[16:48, 16:48] = True
    masks = []
    for flip in flips:
        mask = base.copy()
        mask[16 + rng.integers(32, size=flip), 16 + rng.integers(32, size=flip)] = False
        masks.append(mask)
    other = base.copy()
    other[16, 16:36] = False
    found = find_copies(table(masks=[encode_mask(mask) for mask in (*masks, other)]))
    near = [(a & b).sum() >= 0.995 * (a | b).sum() for a in masks for b in masks]
    assert all(near) <= (found[:-1].nunique() == 1)
    assert found.iloc[-1] == f"m{len(masks)}" or not all(near)


def split(table: pd.DataFrame, **options) -> pd.DataFrame:
    masks = table.assign(category="mug", status="ok", **options)
    return split_models(masks, SplitSettings())


@settings(deadline=None)
@given(objects=st.lists(st.integers(0, 9), min_size=3, max_size=60), seed=st.integers(0, 99))
def test_no_object_stands_in_two_splits_and_none_is_empty(objects, seed):
    masks = table(geometries=[str(name) for name in objects]).assign(status="ok")
    masks = masks.assign(category=[f"c{number % 2}" for number in range(len(objects))])
    if len(set(objects)) < 3:
        with pytest.raises(TactileError, match="different objects"):
            split_models(masks, SplitSettings(seed=seed))
        return
    splits = split_models(masks, SplitSettings(seed=seed)).merge(masks, on="model_id")
    assert (splits.groupby("geometry")["split"].nunique() == 1).all()
    assert set(splits["split"]) == {"train", "eval", "test"}


def test_an_object_of_many_copies_does_not_fill_a_test_split():
    masks = table(geometries=["copy"] * 30 + [f"own{number}" for number in range(70)])
    splits = split(masks)
    assert splits["split"].value_counts().to_dict() == {"train": 80, "test": 10, "eval": 10}
    assert set(splits.loc[splits["copy_of"] == "m0", "split"]) == {"train"}


def test_fewer_than_three_objects_are_refused_with_the_copies_named():
    with pytest.raises(TactileError, match=r"2 different objects, as m1, m2 are copies"):
        split(table(geometries="abb"))


def cup(height: float, radius: float = 1.0) -> trimesh.Trimesh:
    return trimesh.creation.cylinder(radius=radius, height=height, sections=12)


def test_copies_in_files_of_several_kinds_go_to_one_split(tmp_path):
    """Another header, another scale and place, another format: one object each time."""
    for number, height in enumerate([0.4, 0.6, 0.8, 1.0, 1.3, 1.7, 2.3, 3.0]):
        mesh = cup(height)
        text = mesh.export(file_type="obj", include_normals=False)
        folder = tmp_path / "source" / "mug"
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f"a{number}.obj").write_text(text)
        (folder / f"b{number}.obj").write_text(f"# exported again {number}\nmtllib x.mtl\n{text}")
        moved = mesh.copy().apply_scale(3.7).apply_translation([5, -2, 1])
        (folder / f"c{number}.stl").write_bytes(moved.export(file_type="stl"))
    root = UPath(tmp_path / "root")
    settings = MeshSettings(location=str(tmp_path / "source"), classes={"mug": "03797390"})
    manifest = collect_meshes(settings, root, tmp_path / "cache")
    assert manifest["content_hash"].nunique() == 24
    masks = render_masks(manifest, root, SETTINGS)
    splits = split_models(masks, SplitSettings())
    number = splits["model_id"].str[1:2]
    assert (splits.groupby(number)["split"].nunique() == 1).all()
    assert (splits.groupby(number)["copy_of"].nunique() == 1).all()
    assert splits["copy_of"].nunique() == 8
