"""A run that would make nothing new is not begun."""

from tactile_assets.fresh import configured, reason_to_run, whole
from tests.assets.running import ALL, shell


def test_after_a_run_all_is_there_and_nothing_is_stale(chain):
    assert all(whole(chain.store, asset) for asset in ALL)
    # Only that the tests' run had a configuration of its own keeps it from being the profile's.
    assert all(configured(chain.instance, asset) for asset in ALL)
    assert reason_to_run(chain.instance, chain.store).startswith("Made with another configuration")


def test_what_was_never_made_is_named_in_order(platform):
    assert reason_to_run(platform.instance, platform.store) == f"To be made: {', '.join(ALL)}."


def test_what_is_damaged_or_gone_is_no_longer_whole(copy_of_chain):
    artifacts = copy_of_chain.home / "artifacts"
    table = artifacts / "masks.parquet"
    data = bytearray(table.read_bytes())
    data[len(data) // 2] ^= 1
    table.write_bytes(data)
    (artifacts / "policies" / "total-0" / "policy.safetensors").unlink()
    (artifacts / "outlines.parquet").unlink()
    gone = [asset for asset in ALL if not whole(copy_of_chain.store, asset)]
    assert sorted(gone) == ["masks", "outlines", "policies"]


def test_make_run_asks_before_it_begins(chain):
    done = shell("python -m tactile_assets.fresh", chain.home)
    assert done.returncode == 1 and done.stdout.startswith("Made with another configuration")
