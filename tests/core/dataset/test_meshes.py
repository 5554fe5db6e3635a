"""Collecting: good meshes under one root in one manifest, bad ones set aside, nothing twice."""

import os
import random
import zipfile
from pathlib import Path

import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from upath import UPath

from tactile_core.dataset.meshes import collect_meshes
from tactile_core.dataset.sources.parsing import load_mesh
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

BAD = {
    "empty": (b"", "is empty: get it again"),
    "lone": (b"# Blender\n", "has no faces"),
    "nan": (obj() + b"v nan 0 0\nf -1 1 2\n", "has a vertex that is not a finite number"),
    "flat": (b"v 1 1 1\nv 1 1 1\nv 1 1 1\nf 1 2 3\n", "has no extent"),
    "cut": (obj()[:-3], "has a face with fewer than three numbers (is the file cut off?)"),
    "wild": (obj() + b"f 1 2 999\n", "has a face with a vertex that does not exist (of 18)"),
}


@pytest.mark.parametrize("kind", ["archive", "folder"])
def test_bad_meshes_are_set_aside_with_their_reason_and_the_run_goes_on(
    collect, root, tmp_path, kind
):
    members = {f"{MUG}/{name}/{V2}": data for name, (data, _) in BAD.items()}
    members[f"{MUG}/good/{V2}"] = obj()
    if kind == "archive":
        make_zip(tmp_path / f"source/{MUG}.zip", members)
    else:
        make_folder(tmp_path / "source", members)
    manifest = collect().set_index("model_id")
    assert manifest.loc["good", "status"] == "ok"
    for name, (_, reason) in BAD.items():
        assert manifest.loc[name, "status"] == reason
        assert manifest.loc[name, "faces"] == manifest.loc[name, "vertices"] == 0
        assert manifest.loc[name, "content_hash"] != ""
    assert files_under(root) == [manifest.loc["good", "file"]]


def test_a_member_with_a_wrong_checksum_is_set_aside_alone(collect, tmp_path):
    path = tmp_path / f"source/{MUG}.zip"
    path.parent.mkdir()
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        for name, size in (("a", 1.5), ("b", 2.5)):
            archive.writestr(f"{MUG}/{name}/{V1}", obj(size))
    path.write_bytes(path.read_bytes().replace(b"0.75000000", b"0.75000001", 1))
    manifest = collect()
    assert manifest["status"][0].startswith("is damaged in its archive (Bad CRC-32")
    assert manifest["content_hash"][0] == ""
    assert manifest["status"][1] == "ok"


def test_a_class_without_one_usable_mesh_is_an_error(collect, tmp_path):
    make_zip(tmp_path / f"source/{MUG}.zip", {f"{MUG}/{n}/{V2}": d for n, (d, _) in BAD.items()})
    message = refusal(collect)
    assert f"class 'mug': none of its {len(BAD)} meshes can be used" in message
    assert "has a face with fewer than three numbers" in message


def test_a_class_that_is_nowhere_names_what_was_looked_for(collect, tmp_path):
    make_folder(tmp_path / "source", {"other.txt": b""})
    message = refusal(collect)
    for word in ("'mug'", MUG, str(tmp_path / "source"), f"{MUG}.zip", f"{MUG}/", "mug/"):
        assert word in message


def test_a_location_that_does_not_exist_is_named(collect, tmp_path):
    assert f"{tmp_path / 'source'} does not exist" in refusal(collect)


def test_a_location_that_is_a_file_says_to_give_its_folder(collect, tmp_path):
    path = make_zip(tmp_path / f"{MUG}.zip", {f"{MUG}/a/{V1}": obj()})
    assert "give the folder that holds" in refusal(collect, location=path)


def test_an_archive_without_meshes_says_what_was_looked_for(collect, tmp_path):
    make_zip(tmp_path / f"source/{MUG}.zip", {f"{MUG}/a/model.mtl": b""})
    assert "holds no mesh; looked for <id>/model.obj" in refusal(collect)


def test_an_archive_that_is_cut_off_is_named(collect, tmp_path):
    path = make_zip(tmp_path / f"source/{MUG}.zip", {f"{MUG}/a/{V1}": obj()})
    path.write_bytes(path.read_bytes()[:-40])
    assert f"{path} is a zip archive that is cut off" in refusal(collect)


def test_an_archive_with_another_checksum_is_refused(collect, tmp_path):
    make_zip(tmp_path / f"source/{MUG}.zip", {f"{MUG}/a/{V1}": obj()})
    assert "not the expected " + "0" * 64 in refusal(collect, sha256={"mug": "0" * 64})


def test_file_systems_that_are_not_installed_or_unknown_are_told(collect):
    assert "Install adlfs" in refusal(collect, location="abfs://bucket/shapenet")
    assert "nosuch://x cannot be opened" in refusal(collect, location="nosuch://x")


@pytest.mark.parametrize("name", ["../mug", "", "a/b", ".."])
def test_a_class_whose_name_is_no_folder_is_refused(collect, tmp_path, name):
    make_zip(tmp_path / f"source/{MUG}.zip", {f"{MUG}/a/{V1}": obj()})
    assert "cannot name a class or synset" in refusal(collect, classes={name: MUG})


def test_two_classes_of_one_synset_are_refused():
    with pytest.raises(ValidationError, match=f"classes names '{MUG}' twice"):
        MeshSettings(classes={"mug": MUG, "cup": MUG})


def test_a_source_inside_the_mesh_root_is_refused(collect, tmp_path):
    make_folder(tmp_path / "root/mug", {"a.obj": obj()})
    assert "lies where meshes are stored" in refusal(collect, location=tmp_path / "root")
    assert (tmp_path / "root/mug/a.obj").exists()


def test_models_per_class_keeps_the_first_by_id(collect, root, tmp_path):
    make_zip(tmp_path / f"source/{MUG}.zip", {f"{MUG}/{n}/{V1}": obj() for n in "cabd"})
    assert collect(models_per_class=2)["model_id"].tolist() == ["a", "b"]
    assert len(files_under(root)) == 2


def test_files_that_are_there_unchanged_are_not_written_again(collect, root, tmp_path):
    make_zip(tmp_path / f"source/{MUG}.zip", {f"{MUG}/{n}/{V1}": obj() for n in "ab"})
    first = collect()
    paths = [Path(root / file) for file in first["file"]]
    paths[1].write_bytes(b"X" * len(obj()))
    for path in paths:
        os.utime(path, (1, 1))
    pd.testing.assert_frame_equal(collect(), first)
    assert paths[0].stat().st_mtime == 1
    assert paths[1].stat().st_mtime > 1
    assert paths[1].read_bytes() == obj()


def test_meshes_that_are_gone_are_removed_and_other_files_are_left(collect, root, tmp_path):
    archive = tmp_path / f"source/{MUG}.zip"
    make_zip(archive, {f"{MUG}/{n}/{V2}": obj() for n in "ab"})
    collect()
    make_folder(Path(root), {"manifest.parquet": b"x", f"{MUG}/note.txt": b"x"})
    make_zip(archive, {f"{MUG}/b/{V2}": obj()})
    collect()
    assert files_under(root) == [f"{MUG}/b/{V2}", f"{MUG}/note.txt", "manifest.parquet"]
    assert not (root / MUG / "a").exists()


def test_the_manifest_does_not_depend_on_the_order_of_files(collect, tmp_path):
    names = [f"{k:02d}" for k in range(20)]
    tables = []
    for seed in range(3):
        random.Random(seed).shuffle(names)
        source = tmp_path / f"source{seed}"
        make_folder(source, {f"{MUG}/{n}/{V2}": obj(1 + int(n)) for n in names})
        make_zip(source / f"{BOTTLE}.zip", {f"{n}b/{V1}": obj(1 + int(n)) for n in names})
        root = UPath(tmp_path / f"root{seed}")
        tables.append(collect(classes={"mug": MUG, "bottle": BOTTLE}, location=source, root=root))
    pd.testing.assert_frame_equal(tables[0], tables[1])
    pd.testing.assert_frame_equal(tables[0], tables[2])


def test_a_missing_or_spoilt_file_under_the_root_is_named(root):
    with pytest.raises(TactileError, match=r"a/model\.obj is missing: materialise"):
        load_mesh(root, "a/model.obj")
    make_folder(Path(root), {"a/model.obj": b"v 1 2"})
    with pytest.raises(TactileError, match=r"a/model\.obj has no faces: materialise"):
        load_mesh(root, "a/model.obj")


@given(
    st.lists(
        st.sampled_from(["..", ".", "", "a", "models", "~", "C:", "\\", "memory:", MUG, "\n", "…"]),
        max_size=5,
    ),
    st.sampled_from(["model.obj", "cup.obj"]),
)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
def test_no_archive_puts_a_file_outside_of_the_root(tmp_path_factory, folders, name):
    here = tmp_path_factory.mktemp("escape")
    make_zip(here / f"in/source/{MUG}.zip", {"/".join([*folders, name]): obj()})
    wanted = MeshSettings(classes=ONE, location=str(here / "in/source"))
    before = {p for p in here.rglob("*") if p.is_file()}
    try:
        manifest = collect_meshes(wanted, UPath(here / "in/root"), here / "in/cache")
    except TactileError as error:
        written = set()
        message = str(error)
    else:
        written = {str(here / "in/root" / file) for file in manifest["file"]}
        message = ""
    after = {p for p in here.rglob("*") if p.is_file()}
    assert {str(p) for p in after - before} == written
    assert all(Path(p).resolve().is_relative_to(here / "in/root") for p in written)
    assert "\n" not in message
