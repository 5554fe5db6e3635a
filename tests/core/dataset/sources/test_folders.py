"""Odd things among the files of a source: set aside by name, never waited for, never the end."""

import os

import pytest
from upath import UPath

from tactile_core.dataset.sources.places import MissingClassError
from tactile_core.dataset.sources.watching import source_fingerprint
from tactile_core.settings import MeshSettings
from tests.core.dataset.mesh_files import BOTTLE, MUG, ONE, V2, make_folder, make_zip, obj, refusal
from tests.object_store import BUCKET, object_store

BOTH = {"mug": MUG, "bottle": BOTTLE}


def test_only_regular_files_inside_the_folder_are_read(collect, tmp_path):
    make_folder(tmp_path / "elsewhere", {"x.obj": obj(), "more/y.obj": obj()})
    mugs = make_folder(tmp_path / "source/mug", {"good.obj": obj()})
    os.mkfifo(mugs / "pipe.obj")
    (mugs / "zero.obj").symlink_to("/dev/zero")
    (mugs / "nowhere.obj").symlink_to(mugs / "gone.obj")
    (mugs / "out.obj").symlink_to(tmp_path / "elsewhere/x.obj")
    (mugs / "outside").symlink_to(tmp_path / "elsewhere/more")
    (mugs / "within.obj").symlink_to(mugs / "good.obj")
    status = collect().set_index("model_id")["status"]
    assert status[status == "ok"].index.tolist() == ["good", "within"]
    assert "is no regular file" in status["pipe"] and "is no regular file" in status["zero"]
    assert "leads nowhere" in status["nowhere"]
    assert "leads out of its folder" in status["out"]
    assert "leads out of its folder" in status["outside"]


def test_names_that_no_table_or_file_system_takes_set_their_mesh_aside(collect, tmp_path):
    long = "n" * 240 + ".obj"
    for category in ("mug", "bottle"):  # equal names are made longer by that of the class
        make_folder(
            tmp_path / "source" / category, {"good.obj": obj(), f"{'f' * 60}/{long}": obj()}
        )
    with open(os.fsencode(tmp_path / "source/mug") + b"/cup\xff.obj", "wb") as file:  # noqa: PTH123
        file.write(obj())
    manifest = collect(classes={"mug": MUG, "bottle": BOTTLE})
    aside = manifest[manifest["status"] != "ok"]
    assert len(aside) == 3 and (manifest["status"] == "ok").sum() == 2
    assert "cup\\udcff" in aside["model_id"].tolist()
    assert aside["status"].str.contains("not UTF-8|too long a name").all()


def test_one_model_obj_hides_no_other_mesh_and_what_is_left_out_is_counted(collect, tmp_path):
    files = {f"own/scan{k}.obj": obj(1 + k) for k in range(3)}
    files |= {"Blue_Mug/meshes/model.obj": obj(9), "Blue_Mug/meshes/low.ply": b"x", "a.fbx": b"x"}
    make_folder(tmp_path / "source/mug", files)
    manifest = collect()
    assert manifest["model_id"].tolist() == ["Blue_Mug", "scan0", "scan1", "scan2"]
    held = manifest.attrs["sources"][0]
    assert (held["taken"], held["left_out"]) == (4, 2)
    assert "Blue_Mug/meshes/low.ply" in held["which"] and "a.fbx" in held["which"]


def test_an_archive_of_several_synsets_is_not_one_class(collect, tmp_path):
    core = {f"ShapeNetCore.v2/{synset}/a/{V2}": obj() for synset in (MUG, BOTTLE)}
    path = make_zip(tmp_path / "core.zip", core)
    message = refusal(collect, classes={"mug": str(path)}, location=None)
    assert f"holds several synsets ({BOTTLE}, {MUG})" in message
    make_zip(tmp_path / f"source/{MUG}.zip", {f"{BOTTLE}/a/{V2}": obj()})
    assert f"holds {BOTTLE}, and not the synset {MUG}" in refusal(collect)
    make_zip(tmp_path / f"source/{MUG}.zip", {"core/03797390.zip": b"x"})
    assert "archives inside, which are not opened" in refusal(collect)


def test_a_class_that_is_neither_generated_nor_found_says_what_to_change(collect):
    classes = {"mug": MUG, "bottle": BOTTLE}
    message = refusal(collect, classes=classes, location=None, procedural_models={"mug": 2})
    assert "'bottle'" in message and "procedural_models" in message


def test_absence_and_an_empty_folder_are_no_version(make_store, tmp_path):
    store = make_store(head=404)
    with pytest.raises(MissingClassError, match="is not there"):
        source_fingerprint(MeshSettings(classes={"mug": store.url}))
    (tmp_path / "mug").mkdir()
    with pytest.raises(MissingClassError, match="is empty"):
        source_fingerprint(MeshSettings(classes=ONE, location=str(tmp_path)))


def test_a_server_that_tells_no_version_is_named_as_not_watched(make_store):
    store = make_store(etag=None)
    seen = source_fingerprint(MeshSettings(classes={"mug": store.url}))
    assert f"{store.url} is not watched" in seen.unwatched[0]


def test_an_object_of_s3_that_was_overwritten_is_seen(monkeypatch):
    """By another process: the file system here must not answer from what it listed before."""
    with object_store(monkeypatch) as s3:
        settings = MeshSettings(classes=ONE, location=f"s3://{BUCKET}/core")

        def put(name: str, data: bytes) -> str:
            s3.put(f"core/{name}", data)
            return source_fingerprint(settings).versions["mug"]

        first = put(f"{MUG}/a/model.obj", b"old")
        assert source_fingerprint(settings).versions["mug"] == first
        second = put(f"{MUG}/a/model.obj", b"new")
        third = put(f"{MUG}.zip", b"old")
        assert len({first, second, third, put(f"{MUG}.zip", b"new")}) == 4


def test_archives_and_meshes_in_s3_are_those_of_a_disk(monkeypatch, collect, tmp_path):
    """Read from objects, kept as objects, and those that are no longer listed removed."""
    models = {f"{MUG}/{name}/{V2}": obj(size) for name, size in [("a", 1), ("b", 2)]}
    archive = make_zip(tmp_path / f"source/{MUG}.zip", models)
    with object_store(monkeypatch) as s3:
        s3.put(f"core/{MUG}.zip", archive.read_bytes())
        s3.put(f"core/{BOTTLE}/c/{V2}", obj(3))
        make_folder(tmp_path / f"source/{BOTTLE}", {f"c/{V2}": obj(3)})
        s3.put(f"store/{MUG}/old/{V2}", obj(4))
        there = {"location": f"s3://{BUCKET}/core", "root": UPath(f"s3://{BUCKET}/store")}
        in_s3 = collect(classes=BOTH, **there)
        assert in_s3.equals(collect(classes=BOTH))
        stored = [key for key in s3.names() if key.startswith("store/")]
        assert sorted(stored) == sorted(f"store/{file}" for file in in_s3["file"])
        assert s3.get(f"store/{MUG}/a/{V2}") == obj(1)
