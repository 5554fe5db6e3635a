"""Where meshes come from: folders, file systems, servers, the real sample. All the same later."""

import io
import os
import zipfile
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from upath import UPath

from tactile_core.dataset.sources.parsing import load_mesh
from tactile_core.dataset.sources.places import MissingClassError
from tactile_core.dataset.sources.watching import source_fingerprint
from tactile_core.errors import TactileError
from tactile_core.settings import MeshSettings
from tests.core.dataset.mesh_files import (
    BOTTLE,
    MUG,
    ONE,
    V1,
    V2,
    files_under,
    make_folder,
    make_zip,
    obj,
    refusal,
)

REPOSITORY = Path(__file__).resolve().parents[4]
SAMPLE = REPOSITORY / "../shared/data/shapenet_sample"


def test_an_object_store_serves_as_source_and_as_root(collect):
    memory = UPath("memory://shapenet")
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr(f"{MUG}/a/{V2}", obj())
    (memory / f"{MUG}.zip").write_bytes(file.getvalue())
    (memory / BOTTLE / "b" / V1).write_bytes(obj(2))
    root = UPath("memory://store/shapenet_meshes")
    (root / MUG / "old.obj").write_bytes(b"stale")
    for _ in range(2):
        manifest = collect(
            classes={"mug": MUG, "bottle": BOTTLE}, location="memory://shapenet", root=root
        )
        assert manifest["file"].tolist() == [f"{BOTTLE}/b/{V1}", f"{MUG}/a/{V2}"]
        assert (root / f"{MUG}/a/{V2}").read_bytes() == obj()
        assert not (root / MUG / "old.obj").exists()
        assert len(load_mesh(root, manifest["file"][1]).faces) == 32


def test_a_file_url_is_a_location(collect, tmp_path):
    make_zip(tmp_path / f"source/{MUG}.zip", {f"{MUG}/a/{V1}": obj()})
    assert len(collect(location=f"file://{tmp_path}/source")) == 1


def test_linked_folders_are_followed_once_and_loops_end(collect, tmp_path):
    make_folder(tmp_path / "source" / MUG, {f".store/x/{V2}": obj()})
    for name in "dbeca":
        (tmp_path / "source" / MUG / name).symlink_to(tmp_path / "source" / MUG / ".store/x")
    (tmp_path / "source" / MUG / "loop").symlink_to(tmp_path / "source" / MUG)
    assert collect()["model_id"].tolist() == ["a"]


def test_pythons_own_server_serves_archives_and_a_second_run_fetches_none(collect, site, root):
    make_zip(site.folder / f"core/{MUG}.zip", {f"{MUG}/a/{V2}": obj()})
    os.utime(site.folder / f"core/{MUG}.zip", (1e9, 1e9))
    first = collect(location=f"{site.url}/core/")
    assert first["source"].tolist() == ["archive"]
    assert files_under(root) == first["file"].tolist()
    pd.testing.assert_frame_equal(collect(location=f"{site.url}/core"), first)
    assert [status for _, _, status in site.log] == [200, 304]


def test_over_http_a_missing_archive_says_that_folders_cannot_be_listed(collect, site):
    make_folder(site.folder / MUG, {f"a/{V2}": obj()})
    message = refusal(collect, location=site.url)
    assert f"class 'mug' is missing: {site.url}/{MUG}.zip does not exist (404)" in message
    assert "folders cannot be listed" in message


def test_the_archive_of_a_class_may_have_an_address_of_its_own(collect, make_store, tmp_path):
    archive = make_zip(tmp_path / "x.zip", {"x/model.obj": obj(), "y/model.obj": obj(2)})
    store = make_store(body=archive.read_bytes())
    manifest = collect(classes={"vase": store.url}, location=None)
    assert manifest["file"].tolist() == ["vase/x/model.obj", "vase/y/model.obj"]


def test_folders_of_one_s_own_are_classes_without_being_named(tmp_path, collect):
    make_folder(tmp_path / "source", {
        "vase/a.obj": obj(), "vase/b.ply.txt": b"no mesh", "deep cup/c/d.obj": obj(2),
        "notes/readme.txt": b"no mesh", ".trash/e.obj": obj(3), "mug/f.obj": obj(4),
    })  # fmt: skip
    manifest = collect(classes=None)
    assert dict(zip(manifest["category"], manifest["synset"], strict=True)) == {
        "deep cup": "deep cup", "mug": MUG, "vase": "vase",
    }  # fmt: skip
    assert (manifest["status"] == "ok").all()
    before = fingerprint(tmp_path / "source", None)
    make_folder(tmp_path / "source", {"bowl/g.obj": obj(5)})
    assert fingerprint(tmp_path / "source", None) != before


@pytest.mark.parametrize("relative", [False, True])
def test_a_folder_of_loose_meshes_is_one_class(tmp_path, collect, monkeypatch, relative):
    make_folder(tmp_path / "vases", {"a.obj": obj(), "b.obj": obj(2)})
    monkeypatch.chdir(tmp_path)
    manifest = collect(classes=None, location="vases" if relative else tmp_path / "vases")
    assert manifest[["category", "model_id"]].values.tolist() == [["vases", "a"], ["vases", "b"]]


def test_where_a_synset_lies_the_report_s_two_classes_are_asked_for(tmp_path, collect):
    make_folder(tmp_path / "source", {f"{MUG}/a/{V2}": obj(), "vase/b.obj": obj(2)})
    assert "class 'bottle' (synset 02876657) is missing" in refusal(collect, classes=None)
    assert "does not exist" in refusal(collect, classes=None, location=tmp_path / "nothing")


@pytest.mark.parametrize("name", [f"{MUG}.tar.gz", f"{MUG}.7z", "mug.zip"])
def test_an_archive_of_another_kind_or_name_is_told_with_what_is_missing(tmp_path, collect, name):
    (tmp_path / "source").mkdir()
    (tmp_path / "source" / name).write_bytes(b"whatever it holds")
    assert f"unpack {name} as {MUG}/" in refusal(collect)


def fingerprint(location, classes=ONE) -> str:
    return source_fingerprint(MeshSettings(classes=classes, location=str(location)))


def test_the_fingerprint_follows_a_folder_and_an_archive_and_misses_what_is_not_there(tmp_path):
    with pytest.raises(MissingClassError, match="source does not exist"):
        fingerprint(tmp_path / "source")
    make_folder(tmp_path / "source" / MUG, {f"a/{V2}": obj()})
    seen = [fingerprint(tmp_path / "source")]
    make_folder(tmp_path / "source" / MUG, {f"b/{V2}": obj()})
    seen.append(fingerprint(tmp_path / "source"))
    os.utime(tmp_path / "source" / MUG / "b" / V2, (1, 1))
    seen.append(fingerprint(tmp_path / "source"))
    archive = make_zip(tmp_path / f"source/{MUG}.zip", {f"{MUG}/a/{V1}": obj()})
    seen.append(fingerprint(tmp_path / "source"))
    archive.write_bytes(archive.read_bytes() + b"\0")
    seen.append(fingerprint(tmp_path / "source"))
    assert len(set(map(repr, seen))) == len(seen)
    assert fingerprint(tmp_path / "source") == seen[-1]


def test_the_fingerprint_of_a_server_downloads_nothing(site, make_store):
    make_folder(site.folder, {f"{MUG}.zip": b"anything", f"{BOTTLE}.zip": b"new"})
    both = {"mug": MUG, "bottle": BOTTLE}
    first = fingerprint(site.url, both)
    assert fingerprint(site.url, both) == first
    make_folder(site.folder, {f"{BOTTLE}.zip": b"newer"})
    assert fingerprint(site.url, both) != first
    assert {method for method, _, _ in site.log} == {"HEAD"}


def test_the_fingerprint_of_an_object_store_follows_its_objects():
    memory = UPath("memory://prints")
    (memory / MUG / "a" / V1).write_bytes(obj())
    first = fingerprint("memory://prints")
    assert fingerprint("memory://prints") == first
    (memory / MUG / "a" / V1).write_bytes(obj(2))
    assert fingerprint("memory://prints") != first


def test_generated_meshes_have_a_constant_fingerprint():
    assert source_fingerprint(MeshSettings()) == source_fingerprint(MeshSettings(seed=1))


def test_a_server_that_cannot_be_asked_is_named():
    with pytest.raises(TactileError, match=r"127\.0\.0\.1:9/03797390\.zip cannot be asked"):
        fingerprint("http://127.0.0.1:9")


needs_sample = pytest.mark.skipif(not SAMPLE.is_dir(), reason=f"the real sample is not at {SAMPLE}")


@needs_sample
def test_the_real_sample_is_read_whole(collect, root):
    manifest = collect(classes={"mug": MUG, "bottle": BOTTLE}, location=SAMPLE)
    assert manifest["category"].value_counts().to_dict() == {"mug": 16, "bottle": 23}
    assert (manifest["status"] == "ok").all()
    credits = pd.read_csv(SAMPLE / "CREDITS.csv").set_index("model_id")
    assert manifest["faces"].tolist() == credits.loc[manifest["model_id"], "faces"].tolist()
    mesh = load_mesh(root, manifest["file"][0])
    np.testing.assert_allclose(mesh.bounds.sum(axis=0), 0, atol=1e-12)


@needs_sample
def test_the_real_sample_gives_the_same_manifest_over_http(collect, site, tmp_path):
    classes = {"mug": MUG, "bottle": BOTTLE}
    local = collect(classes=classes, location=SAMPLE)
    for archive in SAMPLE.glob("*.zip"):
        (site.folder / archive.name).symlink_to(archive.resolve())
    remote = collect(classes=classes, location=site.url, root=UPath(tmp_path / "other"))
    pd.testing.assert_frame_equal(remote, local)
