"""ShapeNet's layouts and a user's own: which files are meshes, and what they are called."""

import re
from pathlib import Path

import pytest
import trimesh
from upath import UPath

from tactile_core.dataset.sources.parsing import load_mesh
from tactile_core.files import content_hash
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


ZERO = "<zero>"


def zip_with_names(path: Path, members: dict[str, bytes]) -> Path:
    """A zip with zero bytes, which `zipfile` would not write, where a name has `ZERO`."""
    make_zip(path, members)
    path.write_bytes(path.read_bytes().replace(ZERO.encode(), bytes(len(ZERO))))
    return path


def test_a_zero_byte_in_a_member_s_name_leaves_it_out_by_name(collect, tmp_path):
    """`zipfile` would end the names there: two meshes would be none, and a text would be one."""
    odd = {f"{a}{ZERO}{b}": obj(2) for a, b in [("a", "b.obj"), ("c", "/d.obj"), ("e.obj", ".txt")]}
    zip_with_names(tmp_path / f"source/{MUG}.zip", {f"{MUG}/good/{V2}": obj()} | odd)
    manifest = collect()
    assert manifest["model_id"].tolist() == ["good"]
    held = manifest.attrs["sources"][0]
    assert (held["taken"], held["left_out"]) == (1, 3)
    assert "3 with letters in their names that no line takes" in held["which"]
    assert "a" + r"\x00" * len(ZERO) + "b.obj" in held["which"]


def test_where_every_name_has_a_zero_byte_the_archive_says_so(collect, tmp_path):
    zip_with_names(tmp_path / f"source/{MUG}.zip", {f"{ZERO}.obj": obj(), f"b{ZERO}.obj": obj(2)})
    message = refusal(collect)
    assert "holds no mesh" in message
    assert "2 with letters in their names that no line takes: rename them" in message


@pytest.mark.parametrize("letter", ["\n", "\x1b", "\u2028", "\x7f"])
def test_names_that_break_a_line_are_left_out_of_archives_and_folders_alike(
    collect, tmp_path, letter
):
    files = {"good.obj": obj(), f"a{letter}b.obj": obj(2), f"c{letter}/d.obj": obj(3)}
    make_folder(tmp_path / "folder/mug", files)
    make_zip(tmp_path / f"archive/{MUG}.zip", files)
    (tmp_path / "folder/mug" / f"out{letter}").symlink_to(tmp_path)
    for source in ("folder", "archive"):
        manifest = collect(location=tmp_path / source, root=UPath(tmp_path / f"of {source}"))
        assert manifest.loc[manifest["status"] == "ok", "model_id"].tolist() == ["good"]
        held = manifest.attrs["sources"][0]
        assert "2 with letters in their names" in held["which"]
        assert letter not in held["which"] + "".join(manifest["model_id"])


def test_a_name_that_an_archive_holds_twice_is_counted(collect, tmp_path):
    members = {f"{MUG}/{name}/{V2}": obj(size) for name, size in [("a", 1), ("b", 2), ("c", 3)]}
    path = make_zip(tmp_path / f"source/{MUG}.zip", members)
    path.write_bytes(re.sub(b"/[bc]/", b"/a/", path.read_bytes()))
    manifest = collect()
    assert manifest["content_hash"].tolist() == [content_hash(obj(3))]
    held = manifest.attrs["sources"][0]
    assert (held["taken"], held["left_out"]) == (1, 2)
    assert "2 of a name that comes again" in held["which"]


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


def test_names_that_are_still_the_same_are_numbered(collect, root, tmp_path):
    make_folder(tmp_path / "source/mug", {
        "a-b.obj": obj(), "a/b.obj": obj(2), "c/b.obj": obj(3), "d.obj": obj(4), "d.OBJ": obj(5),
        "e/model.obj": obj(6), "e.obj": obj(7),
    })  # fmt: skip
    make_folder(tmp_path / "source/bottle", {"a-b.obj": obj()})
    manifest = collect(classes={"mug": MUG, "bottle": BOTTLE})
    assert manifest["model_id"].tolist() == [
        "bottle-a-b", "mug-a-b-obj", "mug-a-b-obj-2", "mug-c-b", "mug-d-obj", "mug-d-obj-2",
        "mug-e-obj", "mug-e-obj-2",
    ]  # fmt: skip
    assert manifest["content_hash"].nunique() == 7 and (manifest["status"] == "ok").all()
    assert files_under(root) == sorted(manifest["file"])


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
