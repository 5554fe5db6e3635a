"""A user's own folders of meshes, with all that systems and habits leave in them."""

import os
import re
from pathlib import Path

import pytest
from upath import UPath

from tactile_core.dataset.meshes import collect_meshes
from tactile_core.errors import TactileError
from tactile_core.settings import MeshSettings
from tests.core.dataset.mesh_files import (
    BOTTLE,
    MUG,
    V1,
    V2,
    make_folder,
    make_zip,
    obj,
    refusal,
)
from tests.object_store import BUCKET, ObjectStore, object_store


@pytest.fixture
def s3(monkeypatch) -> ObjectStore:
    with object_store(monkeypatch) as store:
        yield store


def test_a_class_that_is_a_link_is_read_as_one_that_was_named(collect, tmp_path):
    make_folder(tmp_path / "elsewhere", {"a.obj": obj()})
    make_folder(tmp_path / "source", {"cup/b.obj": obj(2)})
    (tmp_path / "source/vase").symlink_to(tmp_path / "elsewhere")
    make_folder(tmp_path / "pictures", {"c.png": b"no mesh", ".trash/d.obj": obj(3)})
    (tmp_path / "source/pictures").symlink_to(tmp_path / "pictures")
    manifest = collect(classes=None)
    assert manifest[["category", "model_id"]].values.tolist() == [["cup", "b"], ["vase", "a"]]


def unreadable(monkeypatch, folder: Path) -> None:
    """As for a user who may not look into `folder`; tests may run as one who may do anything."""
    walk = os.walk

    def refuses(top, followlinks, onerror):
        for here, folders, names in walk(top, followlinks=followlinks, onerror=onerror):
            if Path(here) == folder:
                onerror(PermissionError(13, "Permission denied", here))
                folders.clear()
                continue
            yield here, folders, names

    monkeypatch.setattr(os, "walk", refuses)


def test_a_folder_without_a_mesh_that_is_read_is_named(tmp_path):
    make_folder(tmp_path / "source", {
        "mug/a.obj": obj(), "bowl/b.fbx": b"", "vase/all.zip": b"", "cup.zip": b"",
        "notes/read.me": b"", ".trash/c.fbx": b"", "mug/d.fbx": b"",
    })  # fmt: skip
    said: list[str] = []
    settings = MeshSettings(classes=None, location=str(tmp_path / "source"))
    collect_meshes(settings, UPath(tmp_path / "root"), tmp_path / "cache", said.append)
    [told] = [sentence for sentence in said if "are no classes" in sentence]
    assert told.startswith("3 of what lies in ") and "(as bowl/b.fbx)" in told


def test_a_folder_beside_shapenets_is_named_where_it_is_not_looked_at(tmp_path):
    make_folder(tmp_path / "source", {
        f"{MUG}/{V1}": obj(), f"{BOTTLE}/{V1}": obj(2), "04379243/x/model.obj": obj(3),
        "my cups/a.obj": obj(4), ".git/b.obj": obj(5), "taxonomy.json": b"[]",
    })  # fmt: skip
    for classes, categories, told in (
        (None, {"mug", "bottle"}, "(my cups)"),
        ({"cup": "my cups"}, {"cup"}, ""),
    ):
        said: list[str] = []
        settings = MeshSettings(classes=classes, location=str(tmp_path / "source"))
        meshes = collect_meshes(settings, UPath(tmp_path / "root"), tmp_path / "cache", said.append)
        assert set(meshes["category"]) == categories
        about = "".join(sentence for sentence in said if "taken for ShapeNet" in sentence)
        assert told in about and bool(told) == bool(about)


def test_a_loose_mesh_makes_one_class_of_all_and_that_is_told(tmp_path):
    make_folder(tmp_path / "source", {"mug/a.obj": obj(), "cup/b.obj": obj(2), "c.obj": obj(3)})
    said: list[str] = []
    settings = MeshSettings(classes=None, location=str(tmp_path / "source"))
    manifest = collect_meshes(settings, UPath(tmp_path / "root"), tmp_path / "cache", said.append)
    assert set(manifest["category"]) == {"source"}
    assert "lie in it loose (as c.obj): its folders (cup, mug) are classes" in said[0]


@pytest.mark.parametrize("closed", ["vase", "."])
def test_a_folder_that_cannot_be_read_is_told_and_no_class_is_missing_in_silence(
    collect, tmp_path, monkeypatch, closed
):
    make_folder(tmp_path / "source", {"cup/a.obj": obj(), "vase/b.obj": obj(2)})
    unreadable(monkeypatch, tmp_path / "source" / closed)
    message = refusal(collect, classes=None)
    assert f"{tmp_path / 'source' / closed} cannot be read (Permission denied)" in message


def test_what_every_disk_has_is_no_class(collect, tmp_path, monkeypatch):
    make_folder(tmp_path / "source", {"cup/a.obj": obj(), "lost+found/b.obj": obj(2)})
    unreadable(monkeypatch, tmp_path / "source/lost+found")
    assert collect(classes=None)["category"].tolist() == ["cup"]


def test_hidden_files_and_what_macs_leave_are_no_meshes(collect, tmp_path):
    make_folder(tmp_path / "source", {
        "cup/a.obj": obj(), "__MACOSX/cup/._a.obj": b"x", "notes/.trash/b.obj": obj(2),
        "cup/._a.obj": b"x", "mugs (old), new/c.obj": obj(3),
    })  # fmt: skip
    manifest = collect(classes=None)
    assert manifest["category"].tolist() == ["cup", "mugs (old), new"]
    assert (manifest["status"] == "ok").all()


def test_loose_meshes_are_a_class_wherever_they_lie(collect, tmp_path, s3, monkeypatch):
    make_folder(tmp_path / "vases", {"a.obj": obj()})
    monkeypatch.chdir(tmp_path / "vases")
    assert collect(classes=None, location=".")["category"].tolist() == ["vases"]
    s3.put("a.obj", obj())
    for address in (f"s3://{BUCKET}", f"s3://{BUCKET}/"):
        assert collect(classes=None, location=address)["category"].tolist() == [BUCKET]


def test_objects_that_stand_for_folders_are_none(collect, s3):
    for name in ("shapes/", "shapes/cup/", "shapes/vase/"):
        s3.put(name, b"")
    s3.put("shapes/cup/a.obj", obj())
    for address in (f"s3://{BUCKET}/shapes", f"s3://{BUCKET}/shapes/"):
        manifest = collect(classes=None, location=address)
        assert manifest[["category", "status"]].values.tolist() == [["cup", "ok"]]


@pytest.mark.parametrize("address", [f"s3://{BUCKET}/store", "memory://brackets/store"])
def test_a_mesh_with_brackets_in_its_name_goes_alone(collect, tmp_path, s3, address):
    root = UPath(address)
    make_folder(tmp_path / "source/vase", {f"{n}.obj": obj(k + 1) for k, n in
                                           enumerate(["cup1", "cup[1]", "other[a]"])})  # fmt: skip
    collect(classes=None, root=root)
    (tmp_path / "source/vase/cup[1].obj").unlink()
    (tmp_path / "source/vase/other[a].obj").unlink()
    manifest = collect(classes=None, root=root)
    assert manifest["model_id"].tolist() == ["cup1"]
    assert [path.name for path in (root / "vase").iterdir()] == ["cup1.obj"]


@pytest.mark.parametrize("root", ["store", "store/deep", "cup/store"])
@pytest.mark.parametrize("kind", ["disk", "s3"])
def test_meshes_are_not_stored_among_those_that_they_come_from(collect, tmp_path, s3, root, kind):
    if kind == "disk":
        base = str(make_folder(tmp_path / "source", {"cup/a.obj": obj()}))
    else:
        base = f"s3://{BUCKET}/source"
        s3.put("source/cup/a.obj", obj())
    message = refusal(collect, classes=None, location=base, root=UPath(f"{base}/{root}"))
    assert "lies among the meshes of" in message and "TACTILE_STORE" in message
    hidden = UPath(f"{base}/.tactile/artifacts")
    for _ in range(2):
        assert collect(classes=None, location=base, root=hidden)["category"].tolist() == ["cup"]


def test_beside_the_folders_of_named_classes_meshes_may_be_stored(collect, tmp_path):
    make_folder(tmp_path / "source", {f"{MUG}/a/{V2}": obj(), f"{BOTTLE}/b/{V2}": obj(2)})
    root = UPath(tmp_path / "source/artifacts")
    for _ in range(2):
        manifest = collect(classes=None, root=root)
        assert manifest["category"].tolist() == ["bottle", "mug"]


@pytest.mark.parametrize(
    "names",
    [
        ["00000000/mesh.obj", "00000001/mesh.obj"],
        ["03152026/a.obj", "04022026/b.obj"],
        ["new.obj", "vase/old.obj"],
    ],
)
@pytest.mark.parametrize("category", ["vase", "mug"])
def test_all_meshes_in_a_users_folder_are_of_its_class(collect, tmp_path, names, category):
    files = {f"{category}/{name}": obj(k + 1) for k, name in enumerate(names)}
    make_folder(tmp_path / "source", files)
    manifest = collect(classes=None)
    assert len(manifest) == 2 and set(manifest["category"]) == {category}
    assert manifest.attrs["sources"][0]["left_out"] == 0


def test_a_checksum_is_refused_where_there_is_no_archive(collect, tmp_path):
    make_folder(tmp_path / "source" / MUG, {f"a/{V1}": obj()})
    assert "source/03797390 is a folder" in refusal(collect, sha256={"mug": "0" * 64})
    assert "it is generated" in refusal(collect, sha256={"mug": "0" * 64}, location=None)
    archive = make_zip(tmp_path / f"source/{MUG}.zip", {f"{MUG}/a/{V1}": obj()})
    assert re.search("not the expected", refusal(collect, sha256={"mug": "0" * 64})), archive


def test_a_mesh_that_rounding_has_shrunk_to_a_point_is_set_aside(collect, tmp_path):
    corners = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    for scale in (1e-16, 4e-16, 1e-15):
        rows = [f"v {1 + x * scale!r} {1 + y * scale!r} {1 + z * scale!r}" for x, y, z in corners]
        faces = [f"f {a} {b} {c}" for a in range(1, 7) for b in (a + 1,) for c in (a + 2,)]
        make_folder(
            tmp_path / "source/cup", {f"{scale}.obj": "\n".join([*rows, *faces, ""]).encode()}
        )
    make_folder(tmp_path / "source/cup", {"good.obj": obj()})
    manifest = collect(classes=None).set_index("model_id")
    assert manifest.pop("status").to_dict() == {
        "1e-16": "has no extent", "4e-16": "has no extent", "1e-15": "has no extent", "good": "ok",
    }  # fmt: skip


def test_a_location_that_cannot_be_listed_is_told(collect, tmp_path, monkeypatch):
    (tmp_path / "source").mkdir()

    def refuses(path):
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(type(UPath(tmp_path)), "iterdir", refuses)
    with pytest.raises(TactileError, match=r"source cannot be listed: .*Permission denied"):
        collect()
