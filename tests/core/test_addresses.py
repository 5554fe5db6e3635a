"""What is shown of an address, and that a secret is taken from the environment alone."""

import pytest

from tactile_core.addresses import full, redacted, setting_of, shown
from tactile_core.errors import TactileError
from tactile_core.settings import active_profile

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


@pytest.mark.parametrize(
    "address", ["/data/a?b", "https://host.org/a", "sftp://me@host/a", "abfs://box@account.net/a"]
)
def test_an_address_without_a_secret_is_shown_and_taken_as_it_is(address):
    assert shown(address) == full(address) == address
    assert setting_of("A", {"A": address}) == address
