"""ShapeNet's layouts and a user's own: which files are meshes, and what they are called."""

import pytest
import trimesh

from tactile_core.dataset.sources.parsing import load_mesh
from tests.core.dataset.mesh_files import (
    BOTTLE,
    MUG,
    V1,
    V2,
    files_under,
    make_folder,
    make_zip,
    obj,
    refusal,
)


@pytest.mark.parametrize("tail", [V1, V2, "models/model.obj", "model_normalized.obj"])
@pytest.mark.parametrize("above", [f"{MUG}/", ""])
def test_both_shapenet_layouts_are_recognised_in_an_archive(collect, root, tmp_path, tail, above):
    others = {
        f"{above}b/models/solid.binvox": b"x",
        f"{above}b/images/a.png": b"x",
        "notes.txt": b"",
    }
    models = {f"{above}{name}/{tail}": obj(size) for name, size in [("b", 2), ("a", 1)]}
    make_zip(tmp_path / f"source/{MUG}.zip", models | others)
    manifest = collect()
    assert manifest["model_id"].tolist() == ["a", "b"]
    assert manifest["file"].tolist() == [f"{MUG}/a/{tail}", f"{MUG}/b/{tail}"]
    assert (manifest["source"] == "archive").all()
    assert (manifest["status"] == "ok").all()
    assert files_under(root) == manifest["file"].tolist()  # and nothing else was unpacked


@pytest.mark.parametrize("tail", [V1, V2])
def test_an_extracted_archive_is_read_in_place(collect, root, tmp_path, tail):
    make_folder(tmp_path / "source" / MUG, {f"a/{tail}": obj(), "a/texture.jpg": b"x"})
    manifest = collect()
    assert manifest["file"].tolist() == [f"{MUG}/a/{tail}"]
    assert manifest["source"].tolist() == ["folder"]
    assert files_under(root) == manifest["file"].tolist()


def test_v2_is_preferred_where_a_model_has_both(collect, tmp_path):
    make_zip(tmp_path / f"source/{MUG}.zip", {f"{MUG}/a/{V1}": obj(), f"{MUG}/a/{V2}": obj(2)})
    assert collect()["file"].tolist() == [f"{MUG}/a/{V2}"]


def test_an_archive_of_several_synsets_serves_each_class_with_its_own(collect, tmp_path):
    members = {f"core/{MUG}/a/{V1}": obj(), f"core/{BOTTLE}/b/{V1}": obj(2)}
    for synset in (MUG, BOTTLE):
        make_zip(tmp_path / f"source/{synset}.zip", members)
    manifest = collect(classes={"mug": MUG, "bottle": BOTTLE})
    assert manifest[["category", "model_id"]].to_numpy().tolist() == [["bottle", "b"], ["mug", "a"]]


def test_a_users_own_folder_serves_every_kind_of_mesh(collect, root, tmp_path):
    mesh = trimesh.creation.box()
    kinds = {".ply": "ply", ".stl": "stl", ".off": "off", ".glb": "glb", ".OBJ": "obj"}
    data = {s: mesh.export(file_type=kind) for s, kind in kinds.items()}
    data = {s: d.encode() if isinstance(d, str) else d for s, d in data.items()}
    mine = {f"deep/er/cup {k}{s}": d for k, (s, d) in enumerate(data.items())}
    hidden = {".trash/cup.ply": data[".ply"], "._cup.obj": b"x", "readme.txt": b"x"}
    make_folder(tmp_path / "source/mug", mine | hidden)
    manifest = collect()
    assert manifest["model_id"].tolist() == [f"cup {k}" for k in range(5)]
    assert manifest["file"].tolist()[4] == f"{MUG}/cup 4.obj"
    assert manifest["faces"].tolist() == [12] * 5
    for file in manifest["file"]:
        assert load_mesh(root, file).extents.tolist() == pytest.approx([1 / 3**0.5] * 3)


def test_equal_names_are_made_unique_over_all_classes(collect, tmp_path, caplog):
    """01 is a mug, a bottle, and another mug in another format; only 02 keeps its name."""
    off = trimesh.creation.box().export(file_type="off").encode()
    make_folder(tmp_path / "source/mug", {"01.obj": obj(), "01.off": off, "new/01.obj": obj(2)})
    make_folder(tmp_path / "source/bottle", {"01.obj": obj(3), "02.obj": obj(4)})
    manifest = collect(classes={"mug": MUG, "bottle": BOTTLE})
    assert manifest["model_id"].tolist() == [
        "02",
        "bottle-01",
        "mug-01-obj",
        "mug-01-off",
        "mug-new-01",
    ]
    assert manifest["file"].is_unique
    assert "4 meshes share their names" in caplog.text


def test_equal_shapenet_ids_in_two_classes_are_kept_apart(collect, tmp_path):
    for synset in (MUG, BOTTLE):
        make_zip(tmp_path / f"source/{synset}.zip", {f"{synset}/a/{V2}": obj()})
    manifest = collect(classes={"mug": MUG, "bottle": BOTTLE})
    assert manifest["model_id"].tolist() == ["bottle-a", "mug-a"]
    assert manifest["file"].tolist() == [f"{BOTTLE}/bottle-a/{V2}", f"{MUG}/mug-a/{V2}"]


def test_names_that_cannot_be_made_unique_are_told(collect, tmp_path):
    make_folder(tmp_path / "source/mug", {"a-b.obj": obj(), "a/b.obj": obj(), "c/b.obj": obj()})
    make_folder(tmp_path / "source/bottle", {"a-b.obj": obj()})
    message = refusal(collect, classes={"mug": MUG, "bottle": BOTTLE})
    assert "2 meshes would all be called 'mug-a-b-obj'" in message


def test_a_class_with_an_archive_or_folder_of_its_own_needs_no_location(collect, tmp_path):
    make_zip(tmp_path / "chairs.zip", {f"03001627/x/{V1}": obj()})
    make_folder(tmp_path / "cups", {"mine.obj": obj(2)})
    classes = {"chair": str(tmp_path / "chairs.zip"), "cup": str(tmp_path / "cups"), "mug": MUG}
    manifest = collect(classes=classes, location=None, procedural_models={"mug": 2})
    assert manifest["category"].tolist() == ["chair", "cup", "mug", "mug"]
    assert manifest["source"].tolist() == ["archive", "folder", "procedural", "procedural"]
    assert manifest["synset"].tolist() == ["", "", MUG, MUG]
    assert manifest["file"].tolist()[:2] == [f"chair/x/{V1}", "cup/mine.obj"]


def test_without_a_location_meshes_are_generated_in_the_v2_layout(collect, root):
    classes = {"mug": MUG, "bottle": BOTTLE}
    manifest = collect(classes=classes, location=None, procedural_models={"mug": 2, "bottle": 3})
    assert manifest["category"].tolist() == ["bottle"] * 3 + ["mug"] * 2
    assert (manifest["source"] == "procedural").all()
    expected = manifest["synset"] + "/" + manifest["model_id"] + "/" + V2
    assert manifest["file"].tolist() == expected.tolist()
    mesh = load_mesh(root, manifest["file"][0])
    assert (len(mesh.vertices), len(mesh.faces)) == tuple(manifest.loc[0, ["vertices", "faces"]])


def test_a_class_that_cannot_be_generated_says_where_to_get_it(collect):
    message = refusal(collect, classes={"chair": "03001627"}, location=None)
    assert "'chair'" in message
    assert "location" in message
