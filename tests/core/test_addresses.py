"""What is shown of an address, and that a secret is taken from the environment alone."""

import pytest

from tactile_core.addresses import full, redacted, setting_of, shown
from tactile_core.dataset.sources.folders import as_path
from tactile_core.dataset.things import find_thing
from tactile_core.errors import TactileError
from tactile_core.home import find_artifacts, find_home
from tactile_core.profiles import active_profile

SECRET = [
    "https://user:hush@host.org/a?X-Amz-Signature=hush",
    "https://hush@host.org/a",
    "https://host.org/a?sig=hush",
    "s3://key:hu/hush@bucket/a",
    "sftp://user:hush@host.org/a",
]


@pytest.mark.parametrize("address", SECRET)
def test_a_secret_is_never_shown_and_a_setting_must_not_hold_it(address, monkeypatch):
    assert "hush" not in shown(address)
    assert "hush" not in redacted(f"cannot open '{address}', sorry")
    with pytest.raises(TactileError, match="environment variable") as caught:
        full(address)
    assert "hush" not in str(caught.value)
    monkeypatch.setenv("TACTILE_SHAPENET", address)
    assert setting_of("TACTILE_SHAPENET") == "$TACTILE_SHAPENET"
    assert full("$TACTILE_SHAPENET") == address
    profile = active_profile({"TACTILE_SHAPENET": address, "TACTILE_REAL": address})
    assert profile.meshes.location == "$TACTILE_SHAPENET" and profile.real == "$TACTILE_REAL"


ODD = ["\0", "\n", "\r", "\x1b", "\x7f", "\x85", "\u2028", "\ud800", "\udce9"]


@pytest.mark.parametrize("letter", ODD)
@pytest.mark.parametrize("address", ["/data/{}x", "{}", "http://host/{}x", "s3://b/{}", "$A{}"])
def test_letters_that_no_address_holds_are_told_in_one_line(letter, address, tmp_path):
    address = address.format(letter)
    with pytest.raises(TactileError, match="in it, which no address holds") as caught:
        full(address)
    assert str(caught.value).isprintable()
    for variable in ("TACTILE_SHAPENET", "TACTILE_REAL"):
        with pytest.raises(TactileError, match=f"^{variable}: .* which no address holds"):
            active_profile({variable: address})
    with pytest.raises(TactileError, match="in it, which no address holds"):
        find_artifacts({"TACTILE_STORE": address})
    with pytest.raises(TactileError, match="name another") as caught:
        find_home({"TACTILE_HOME": str(tmp_path / letter)})
    assert str(caught.value).isprintable()


@pytest.mark.parametrize("letter", ["\0", "\n", "\ud800"])
def test_a_password_beside_such_a_letter_is_not_shown(letter):
    with pytest.raises(TactileError) as caught:
        full(f"https://user:hu{letter}sh@host.org/a?sig=hu{letter}sh")
    assert "hu" not in str(caught.value)


def test_what_is_no_address_at_all_is_told(tmp_path):
    for address in ("http://[x/", "https://user:hush@[x/"):
        with pytest.raises(TactileError, match="is no address: correct it") as caught:
            full(address)
        assert "hush" not in str(caught.value)
    with pytest.raises(TactileError, match="cannot be opened"):
        as_path("zip://nothing.zip")


def test_a_variable_s_address_is_looked_at_when_it_is_used(monkeypatch):
    monkeypatch.setenv("ELSEWHERE", "/data/\x1b")
    with pytest.raises(TactileError, match="which no address holds"):
        full("$ELSEWHERE")


def test_any_error_is_one_line_whatever_letters_the_names_in_it_have():
    with pytest.raises(TactileError) as caught:
        find_thing("a\n\0b.obj", 64)
    assert str(caught.value).startswith("a\\n\\x00b.obj is not there")


@pytest.mark.parametrize(
    "address", ["/data/a?b", "https://host.org/a", "sftp://me@host/a", "abfs://box@account.net/a"]
)
def test_an_address_without_a_secret_is_shown_and_taken_as_it_is(address):
    assert shown(address) == full(address) == address
    assert setting_of("A", {"A": address}) == address
