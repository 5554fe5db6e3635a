"""A file appears whole or not at all, and a disk that takes no more is told in a sentence."""

import pytest

from tactile_core.errors import TactileError
from tactile_core.files import remove_parts, written_whole
from tests.disks import make_read_only, small_disk


def write(path, data: bytes) -> None:
    with written_whole(path) as file:
        file.write(data)


def test_a_full_disk_is_told_and_the_file_stays_as_it_was(tmp_path):
    with small_disk(tmp_path / "disk", kilobytes=64):
        file = tmp_path / "disk" / "table"
        write(file, b"old")
        with pytest.raises(
            TactileError, match=r"table cannot be written \(No space left on device"
        ):
            write(file, bytes(100_000))
        assert [(f.name, f.read_bytes()) for f in file.parent.iterdir()] == [("table", b"old")]
        write(file, b"new")
        assert file.read_bytes() == b"new"


def test_a_read_only_disk_is_told_and_the_file_stays_as_it_was(tmp_path):
    with small_disk(tmp_path / "disk", kilobytes=64):
        file = tmp_path / "disk" / "table"
        write(file, b"old")
        make_read_only(file.parent)
        with pytest.raises(TactileError, match=r"table cannot be written \(Read-only file system"):
            write(file, b"new")
        assert file.read_bytes() == b"old"


def test_an_error_that_may_pass_is_handed_on_as_it_is(tmp_path):
    with pytest.raises(ConnectionResetError), written_whole(tmp_path / "table"):
        raise ConnectionResetError
    assert not list(tmp_path.iterdir())


def test_half_written_files_are_removed_and_downloads_stay(tmp_path):
    unfinished = written_whole(tmp_path / "deep" / "table")
    unfinished.__enter__().write(b"half")
    for name in ("model.zip.part", "table", ".hidden.part"):
        (tmp_path / "deep" / name).write_text("whole")
    assert remove_parts(tmp_path) == 1
    left = {file.name for file in (tmp_path / "deep").iterdir()}
    assert left == {"model.zip.part", "table", ".hidden.part"}
