"""Meshes from archives, folders, servers and generators end up under one root, in one manifest."""

import io
import os
import random
import zipfile
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from upath import UPath

from tactile_core.dataset.meshes import collect_meshes, load_mesh
from tactile_core.dataset.places import source_fingerprint
from tactile_core.errors import TactileError
from tactile_core.settings import MeshSettings

REPOSITORY = Path(__file__).parents[3]
SAMPLE = REPOSITORY / "../shared/data/shapenet_sample"
MUG, BOTTLE = "03797390", "02876657"
V1, V2 = "model.obj", "models/model_normalized.obj"
ONE = {"mug": MUG}


def obj(size: float = 1.0) -> bytes:
    mesh = trimesh.creation.cylinder(1, size, sections=8)
    return b"mtllib lost.mtl\n" + mesh.export(file_type="obj", header=None).encode()


def make_zip(path: Path, members: dict[str, bytes]) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return path


def make_folder(path: Path, files: dict[str, bytes]) -> Path:
    for name, data in files.items():
        (path / name).parent.mkdir(parents=True, exist_ok=True)
        (path / name).write_bytes(data)
    return path


@pytest.fixture
def collect(tmp_path):
    """Collect into `tmp_path/root`; the location is `tmp_path/source` unless another is given."""

    def run(classes=ONE, location=tmp_path / "source", root=None, **options) -> pd.DataFrame:
        wanted = MeshSettings(
            classes=classes, location=None if location is None else str(location), **options
        )
        return collect_meshes(wanted, root or UPath(tmp_path / "root"), tmp_path / "cache")

    return run


@pytest.fixture
def root(tmp_path) -> UPath:
    return UPath(tmp_path / "root")


def refusal(collect, **options) -> str:
    with pytest.raises(TactileError) as caught:
        collect(**options)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def files_under(root: UPath) -> list[str]:
    return sorted(p.relative_to(root).as_posix() for p in Path(root).rglob("*") if p.is_file())


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


BAD = {
    "empty": (b"", "has no faces"),
    "nan": (obj() + b"v nan 0 0\n", "has a vertex that is not a finite number"),
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
    assert "class 'mug': none of its 5 meshes can be used" in message
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


def test_a_corrupted_archive_says_to_fetch_it_again(collect, tmp_path):
    path = make_zip(tmp_path / f"source/{MUG}.zip", {f"{MUG}/a/{V1}": obj()})
    path.write_bytes(path.read_bytes()[:-40])
    assert f"{path} is damaged or not a zip file" in refusal(collect)


def test_an_archive_with_another_checksum_is_refused(collect, tmp_path):
    make_zip(tmp_path / f"source/{MUG}.zip", {f"{MUG}/a/{V1}": obj()})
    assert "not the expected " + "0" * 64 in refusal(collect, sha256={"mug": "0" * 64})


def test_file_systems_that_are_not_installed_or_unknown_are_told(collect):
    assert "Install s3fs" in refusal(collect, location="s3://bucket/shapenet")
    assert "nosuch://x cannot be opened" in refusal(collect, location="nosuch://x")


@pytest.mark.parametrize("name", ["../mug", "", "a/b", ".."])
def test_a_class_whose_name_is_no_folder_is_refused(collect, tmp_path, name):
    make_zip(tmp_path / f"source/{MUG}.zip", {f"{MUG}/a/{V1}": obj()})
    assert "cannot name a class or synset" in refusal(collect, classes={name: MUG})


def test_two_classes_of_one_synset_are_refused(collect):
    assert "cup and mug both stand for" in refusal(collect, classes={"mug": MUG, "cup": MUG})


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
    make_folder(tmp_path / "elsewhere", {f"x/{V2}": obj()})
    (tmp_path / "source" / MUG).mkdir(parents=True)
    for name in "dbeca":
        (tmp_path / "source" / MUG / name).symlink_to(tmp_path / "elsewhere/x")
    (tmp_path / "source" / MUG / "loop").symlink_to(tmp_path / "source")
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


def fingerprint(location, classes=ONE) -> str:
    return source_fingerprint(MeshSettings(classes=classes, location=str(location)))


def test_the_fingerprint_follows_an_archive_a_folder_and_a_class_that_appears(tmp_path):
    seen = [fingerprint(tmp_path / "source")]  # nothing there
    make_folder(tmp_path / "source" / MUG, {f"a/{V2}": obj()})
    seen.append(fingerprint(tmp_path / "source"))
    make_folder(tmp_path / "source" / MUG, {f"b/{V2}": obj()})
    seen.append(fingerprint(tmp_path / "source"))
    os.utime(tmp_path / "source" / MUG / "b" / V2, (1, 1))
    seen.append(fingerprint(tmp_path / "source"))
    archive = make_zip(tmp_path / f"source/{MUG}.zip", {f"{MUG}/a/{V1}": obj()})
    seen.append(fingerprint(tmp_path / "source"))
    archive.write_bytes(archive.read_bytes() + b"\0")
    seen.append(fingerprint(tmp_path / "source"))
    assert len(set(seen)) == len(seen)
    assert fingerprint(tmp_path / "source") == seen[-1]


def test_the_fingerprint_of_a_server_downloads_nothing(site, make_store):
    make_folder(site.folder, {f"{MUG}.zip": b"anything"})
    both = {"mug": MUG, "bottle": BOTTLE}
    first = fingerprint(site.url, both)
    assert fingerprint(site.url, both) == first
    make_folder(site.folder, {f"{BOTTLE}.zip": b"new"})
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
