"""Files that are no zip archive, or an odd one, are called what they are."""

import re
import zipfile

import pytest

from tactile_core.dataset.sources.archives import open_archive
from tests.core.dataset.sources.zips import GOOD, make_zip, read, refusal

NONE = {
    "lfs": (b"version https://git-lfs.github.com/spec/v1\noid sha256:aa\n", "Git LFS pointer"),
    "page": (b"\n<!DOCTYPE html><html>Sign in</html>", "is a web page, .* sign in there"),
    "xml": (b"<?xml version='1.0'?><Error><Code>AccessDenied</Code></Error>", "is an XML text"),
    "empty": (b"", "is empty"),
    "zeros": (bytes(5000), "nothing but zeros"),
    "gzip": (b"\x1f\x8b\x08" + bytes(50), r"is a gzip file, as \.tar\.gz, .*give its folder"),
    "7z": (b"7z\xbc\xaf'\x1c" + bytes(50), "is a 7z archive"),
    "rar": (b"Rar!\x1a\x07" + bytes(50), "is a RAR archive"),
    "tar": (b"a" * 257 + b"ustar" + bytes(250), "is a tar archive"),
    "json": (b'{"message": "not found"}', "is a text"),
    "other": (b"\x00\x01\x02" * 90, "is no zip archive"),
    "part": (b"PK\x07\x08PK\x03\x04" + bytes(50), "one of several parts"),
}


@pytest.mark.parametrize("kind", NONE)
def test_an_archive_that_is_none_is_called_what_it_is_and_nobody_is_told_to_delete_it(
    tmp_path, kind
):
    data, said = NONE[kind]
    (tmp_path / "a.zip").write_bytes(data)
    message = refusal(tmp_path / "a.zip")
    assert re.search(said, message)
    assert "delete" not in message
    assert (tmp_path / "a.zip").exists()


def test_the_last_of_several_parts_is_called_so(tmp_path):
    path = make_zip(tmp_path / "a.zip", {GOOD: b"v"})
    data = bytearray(path.read_bytes())
    data[data.rindex(b"PK\x05\x06") + 4] = 2
    path.write_bytes(data)
    assert "is the last of 3 parts of a zip archive: join them" in refusal(path)


END = b"PK\x05\x06"


@pytest.mark.parametrize("comment", [END, b"a" + END + bytes(18), b"x" * 40 + END + b"y" * 40])
def test_a_comment_with_the_mark_of_an_archive_s_end_is_called_so(tmp_path, comment):
    path = make_zip(tmp_path / "a.zip", {GOOD: b"v"})
    with zipfile.ZipFile(path, "a") as archive:
        archive.comment = comment
    assert "whose comment holds the mark by which an archive's end is found" in refusal(path)


def test_a_comment_and_bytes_to_spare_do_no_harm(tmp_path):
    path = make_zip(tmp_path / "a.zip", {GOOD: b"v"})
    with zipfile.ZipFile(path, "a") as archive:
        archive.comment = b"made by hand"
    for spare in (b"", b"\0", bytes(30)):
        path.write_bytes(path.read_bytes() + spare)
        with open_archive(path) as archive:
            assert read(archive, GOOD) == b"v"


def test_an_archive_in_the_long_format_is_read(tmp_path):
    path = tmp_path / "a.zip"
    with zipfile.ZipFile(path, "w") as archive, archive.open(GOOD, "w", force_zip64=True) as file:
        file.write(b"v")
    with open_archive(path) as archive:
        assert read(archive, GOOD) == b"v"


def test_a_truncated_archive_says_so_and_is_left_where_it_is(tmp_path):
    path = make_zip(tmp_path / "a.zip", {GOOD: b"v" * 1000})
    path.write_bytes(path.read_bytes()[:-30])
    assert "is cut off, its end is missing" in refusal(path)
    assert path.exists()


def test_a_name_that_is_not_what_it_says_is_told(tmp_path):
    path = make_zip(tmp_path / "a.zip", {GOOD: b"v", "caf\u00e9.txt": b"x"})
    path.write_bytes(path.read_bytes().replace("\u00e9".encode(), b"\xe9\xe9"))
    assert "whose name is not in UTF-8, as it says it is: pack it anew" in refusal(path)


def test_a_missing_archive_is_named(tmp_path):
    assert "is missing" in refusal(tmp_path / "a.zip")
