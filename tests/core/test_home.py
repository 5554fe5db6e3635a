"""The home is the one that was named, or nothing is done."""

import os

import pytest

from tactile_core.errors import TactileError
from tactile_core.home import (
    check_one_home,
    default_home,
    find_artifacts,
    find_home,
    remembered_profile,
)
from tactile_core.profiles import active_profile


def test_a_home_that_is_not_there_yet_is_made(tmp_path):
    home = tmp_path / "ümläut 日本" / "[1]{a}:b#1 50% off"
    assert find_home({"TACTILE_HOME": str(home)}) == home
    assert home.is_dir()


def test_without_a_name_it_lies_in_the_checkout():
    assert default_home().name == ".tactile"
    assert find_home({"TACTILE_HOME": ""}) == default_home().resolve()


def test_a_home_is_the_same_by_every_way_there(tmp_path, monkeypatch):
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to("real")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path))
    ways = ["real", "real/", "./link", "~/link", str(tmp_path / "link" / ".." / "real")]
    assert {find_home({"TACTILE_HOME": way}) for way in ways} == {tmp_path / "real"}


def test_a_tilde_is_the_users_own_folder_or_it_is_refused(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    assert find_home({"TACTILE_HOME": "~/tactile"}) == tmp_path / "tactile"
    assert find_artifacts({"TACTILE_STORE": "~/store"}) == f"{tmp_path}/store"
    assert find_artifacts({"TACTILE_STORE": "s3://bucket/~x"}) == "s3://bucket/~x"
    for name in ("TACTILE_HOME", "TACTILE_STORE"):
        with pytest.raises(TactileError, match="folder of a user that is not known here"):
            find_artifacts({name: "~no-such-user/x"})


@pytest.mark.parametrize("name", ["q?x", "My%20Project", "two\nlines", "a%2Fb"])
def test_a_name_that_dagster_s_database_cannot_have_is_refused(tmp_path, name):
    with pytest.raises(TactileError, match="cannot be used") as refused:
        find_home({"TACTILE_HOME": str(tmp_path / name)})
    assert "\n" not in str(refused.value)
    assert not any(tmp_path.iterdir())


def test_a_file_or_what_lies_below_one_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    for home in ("file", "file/below", "/proc/nowhere/below"):
        with pytest.raises(TactileError, match="cannot be made") as refused:
            find_home({"TACTILE_HOME": str(tmp_path / home)})
        assert home in str(refused.value)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_that_may_not_be_written_to_is_refused(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(TactileError, match="cannot be written to"):
        find_home({"TACTILE_HOME": str(tmp_path)})


def test_dagster_s_records_lie_in_the_home_or_nothing_is_done(tmp_path):
    check_one_home(tmp_path, {})
    check_one_home(tmp_path, {"DAGSTER_HOME": f"{tmp_path}/dagster/"})
    with pytest.raises(TactileError, match="activate the environment again"):
        check_one_home(tmp_path, {"DAGSTER_HOME": str(tmp_path / "other" / "dagster")})


@pytest.mark.parametrize(
    "store",
    [
        "sftp://me:hushhush@host/a",
        "s3://key:hush/hush@bucket/a",
        "https://h/a?X-Amz-Signature=hush",
    ],
)
def test_a_store_s_password_is_no_part_of_its_address(store, tmp_path):
    """It would stand in every message about a file, and in what Dagster stores."""
    with pytest.raises(TactileError, match="holds a password or signature") as refused:
        find_artifacts({"TACTILE_STORE": store})
    assert "hush" not in str(refused.value) and "\n" not in str(refused.value)
    assert "FSSPEC_" in str(refused.value)
    for plain in ("s3://bucket/a", "sftp://me@host/a", "/data/a?b"):
        assert find_artifacts({"TACTILE_STORE": plain}) == plain
    home = {"TACTILE_HOME": str(tmp_path)}
    assert find_artifacts(home) == f"{tmp_path}/artifacts"


def test_a_store_that_is_the_home_or_another_in_every_folder_is_refused(tmp_path):
    home = {"TACTILE_HOME": str(tmp_path)}
    for way in (str(tmp_path), f"{tmp_path}/", f"{tmp_path}/x/.."):
        with pytest.raises(TactileError, match="is the home itself"):
            find_artifacts({**home, "TACTILE_STORE": way})
    for way in ("store", "./store", "../store"):
        with pytest.raises(TactileError, match="give its whole path"):
            find_artifacts({**home, "TACTILE_STORE": way})


def test_a_profile_that_cannot_be_read_is_not_taken_for_none(tmp_path):
    home = {"TACTILE_HOME": str(tmp_path)}
    assert remembered_profile(home) is None
    (tmp_path / "profile").write_bytes(b"\xff")
    with pytest.raises(TactileError, match="let TACTILE_PROFILE name a profile"):
        remembered_profile(home)
    assert active_profile({**home, "TACTILE_PROFILE": "smoke"}).name == "smoke"
