"""Zip archives: nothing leads out of its folder, nothing bursts, and damage is told clearly."""

import contextlib
import io
import random
import stat
import tempfile
import zipfile
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from tactile_core.dataset.sources import archives
from tactile_core.dataset.sources.archives import open_archive, read_member, safe_members
from tactile_core.errors import TactileError

GOOD = "03797390/a/model.obj"


def make_zip(path: Path, members: dict[str, bytes]) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return path


def refusal(path: Path) -> str:
    """The message with which the archive must be refused: one line that names it."""
    with pytest.raises(TactileError) as caught, open_archive(path) as archive:
        safe_members(archive, [".obj"])
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_meshes_are_listed_in_order_and_read_back(tmp_path):
    members = {"b/model.obj": b"two", "a/model.OBJ": b"one", "a/texture.png": b"3", "x.obj/": b""}
    with open_archive(make_zip(tmp_path / "a.zip", members)) as archive:
        assert safe_members(archive, [".obj"]) == ["a/model.OBJ", "b/model.obj"]
        assert read_member(archive, "b/model.obj") == b"two"


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("../evil.obj", "leads out of its folder"),
        ("03797390/../../evil.txt", "leads out of its folder"),
        ("a/..", "leads out of its folder"),
        ("/etc/evil.obj", "absolute path"),
        ("C:/evil.obj", "absolute path"),
        ("c:evil.obj", "absolute path"),
        ("..\\evil.obj", "backslash"),
        ("a\\b\\model.obj", "backslash"),
        ("a/" + "n" * 300 + ".obj", "name of more than 200 bytes"),
        ("line\nbreak/../evil.obj", "leads out of its folder"),
    ],
)
def test_a_path_that_escapes_refuses_the_whole_archive(tmp_path, name, why):
    message = refusal(make_zip(tmp_path / "a.zip", {GOOD: b"v", name: b"v"}))
    assert why in message
    assert repr(name[:80]) in message


@pytest.mark.parametrize(
    ("kind", "why"), [(stat.S_IFLNK, "is a link"), (stat.S_IFIFO, "neither a file nor a folder")]
)
def test_links_and_devices_are_refused(tmp_path, kind, why):
    path = tmp_path / "a.zip"
    with zipfile.ZipFile(path, "w") as archive:
        member = zipfile.ZipInfo("a/model.obj")
        member.external_attr = (kind | 0o777) << 16
        archive.writestr(member, "/etc/passwd")
    assert why in refusal(path)


def test_a_small_member_that_unpacks_to_a_large_one_is_refused(tmp_path):
    path = make_zip(tmp_path / "a.zip", {"a/model.obj": bytes(archives.RATIO_MATTERS_FROM + 1)})
    assert path.stat().st_size < 20_000
    assert "unpacks to more than 200 times its size" in refusal(path)


def test_meshes_that_are_too_large_are_refused(tmp_path, monkeypatch):
    members = {f"{k}/model.obj": random.Random(k).randbytes(600) for k in range(3)}
    path = make_zip(tmp_path / "a.zip", members)
    monkeypatch.setattr(archives, "MAX_TOTAL", 1700)
    assert "'2/model.obj' makes the meshes unpack to more than" in refusal(path)
    monkeypatch.setattr(archives, "MAX_FILE", 599)
    assert "'0/model.obj' unpacks to" in refusal(path)


def test_what_is_never_unpacked_may_be_of_any_size(tmp_path):
    members = {GOOD: b"v", "03797390/a/solid.binvox": bytes(archives.RATIO_MATTERS_FROM + 1)}
    with open_archive(make_zip(tmp_path / "a.zip", members)) as archive:
        assert safe_members(archive, [".obj"]) == [GOOD]


def test_a_member_that_lies_about_its_size_yields_no_more_than_it_said(tmp_path):
    """The directory says 10 bytes, the member holds a million."""
    path = make_zip(tmp_path / "a.zip", {GOOD: bytes(1_000_000)})
    data = path.read_bytes()
    path.write_bytes(data.replace((1_000_000).to_bytes(4, "little"), (10).to_bytes(4, "little")))
    with open_archive(path) as archive:
        assert safe_members(archive, [".obj"]) == [GOOD]
        with pytest.raises(TactileError, match="damaged in its archive"):
            read_member(archive, GOOD)


def test_one_damaged_member_leaves_the_others_readable(tmp_path):
    path = tmp_path / "a.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        archive.writestr("a/model.obj", "the first")
        archive.writestr("b/model.obj", "the second")
    path.write_bytes(path.read_bytes().replace(b"the first", b"the farst"))
    with open_archive(path) as archive:
        with pytest.raises(TactileError, match=r"is damaged in its archive .*CRC"):
            read_member(archive, "a/model.obj")
        assert read_member(archive, "b/model.obj") == b"the second"


def test_an_encrypted_member_says_so(tmp_path):
    path = make_zip(tmp_path / "a.zip", {GOOD: b"v"})
    data = bytearray(path.read_bytes())
    data[data.index(b"PK\x01\x02") + 8] |= 1
    data[6] |= 1
    path.write_bytes(data)
    with (
        open_archive(path) as archive,
        pytest.raises(TactileError, match="encrypted, password required"),
    ):
        read_member(archive, GOOD)


def test_a_truncated_archive_says_to_fetch_it_again(tmp_path):
    path = make_zip(tmp_path / "a.zip", {GOOD: b"v" * 1000})
    path.write_bytes(path.read_bytes()[:-30])
    assert "delete it and fetch it again" in refusal(path)


def test_a_page_of_html_is_no_archive(tmp_path):
    (tmp_path / "a.zip").write_text("<html>Please log in</html>")
    assert "damaged or not a zip file" in refusal(tmp_path / "a.zip")


def test_a_missing_archive_is_named(tmp_path):
    assert "is missing" in refusal(tmp_path / "a.zip")


parts = st.one_of(
    st.sampled_from(["..", ".", "", "/", "C:", "\\", "~", "...", "model.obj", "a", "memory:"]),
    st.text(max_size=6),
)


@given(st.lists(parts, min_size=1, max_size=5).map("/".join).map(lambda n: n + ".obj"))
@example("....//model.obj")
@example("a/\0/../../model.obj")
def test_no_name_that_is_let_through_leads_out_of_the_folder_it_is_joined_to(name):
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        try:
            archive.writestr(name, b"")
        except UnicodeEncodeError:
            return
    with tempfile.TemporaryDirectory() as folder, zipfile.ZipFile(file) as archive:
        target = Path(folder, "target").resolve()
        try:
            names = safe_members(archive, [".obj"])
        except TactileError:
            return
        for member in names:
            assert (target / member).resolve().is_relative_to(target)
            assert Path(f"{target}/{member}").resolve().is_relative_to(target)


@given(seed=st.integers(0, 10_000))
def test_a_damaged_archive_never_ends_in_another_error(seed):
    rng = random.Random(seed)
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", rng.choice([0, 8, 12, 14])) as archive:
        for name in ("a/model.obj", "b/models/model_normalized.obj"):
            archive.writestr(name, rng.randbytes(50) * 4)
    data = bytearray(file.getvalue())
    for _ in range(rng.randint(1, 6)):
        data[rng.randrange(len(data))] = rng.randrange(256)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "a.zip")
        path.write_bytes(data[: rng.choice([len(data), rng.randrange(len(data))])])
        with contextlib.suppress(TactileError), open_archive(path) as archive:
            for name in safe_members(archive, [".obj"]):
                with contextlib.suppress(TactileError):
                    read_member(archive, name)
