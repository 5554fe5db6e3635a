"""A run that would make nothing new is not begun."""

import shutil
from collections.abc import Iterator

import dagster as dg
import pytest

from tactile_assets.fresh import (
    configured,
    reason_to_run,
    stored_version,
    unpassed_checks,
    what_is_stored,
)
from tactile_assets.paths import REPOSITORY
from tactile_assets.provenance import own_instance
from tactile_core.errors import TactileError
from tactile_core.parquet import read_table, write_table
from tests.assets.running import ALL, TINY, Platform, nothing, shell
from tests.disks import small_disk
from tests.shared import copied


@pytest.fixture
def lived_in(chain, tmp_path) -> Iterator[Platform]:
    """The home of the finished run with its records, copied."""
    home = tmp_path / "home"
    copied(chain.home, home, symlinks=True)
    with dg.DagsterInstance.from_config(str(home / "dagster")) as instance:
        yield Platform(home, instance)


def test_after_a_run_all_is_there_and_nothing_is_stale(chain):
    assert what_is_stored(chain.instance, chain.store, ALL) == ""
    assert unpassed_checks(chain.instance) == ""
    # Only that the tests' run had a configuration of its own keeps it from being the profile's.
    assert {asset for asset in ALL if configured(chain.instance, asset)} == {*TINY}
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
    gone = [asset for asset in ALL if stored_version(copy_of_chain.store, asset) is None]
    assert sorted(gone) == ["masks", "outlines", "policies"]


def test_what_another_home_put_into_the_store_is_named(lived_in):
    """It is whole, and none of what these records tell of."""
    place = lived_in.store.path("outlines.parquet")
    write_table(read_table(place)[1:], place)
    index = lived_in.home / "artifacts" / "policies" / "index.json"
    index.write_text("{}")
    assert what_is_stored(lived_in.instance, lived_in.store, ALL) == (
        "Other content than this home made, as its records tell: outlines, policies."
    )


@pytest.mark.parametrize("gone", [True, False], ids=["gone", "of another run"])
def test_a_figure_that_an_asset_shows_no_more_is_a_reason_to_run(lived_in, gone):
    figure = lived_in.home / "artifacts" / "figures" / "figure_4.png"
    if gone:
        figure.unlink()
    else:
        figure.write_bytes(b"another")
    assert what_is_stored(lived_in.instance, lived_in.store, ALL) == (
        "Figures are missing, or others: of per_step_evaluation."
    )


def test_checks_that_failed_or_were_not_made_of_what_is_stored_are_named(lived_in):
    place = lived_in.store.path("rotated_splits.parquet")
    write_table(read_table(place).assign(model_id="one"), place)
    lived_in.check("rotated_splits")
    lived_in.instance.report_runless_asset_event(dg.AssetMaterialization("outlines"))
    assert unpassed_checks(lived_in.instance) == (
        "Checks that have not passed: classes_are_balanced of rotated_splits, "
        "no_model_in_two_splits of rotated_splits, "
        "outlines_lie_on_their_masks of outlines (not made)."
    )


def test_make_run_asks_before_it_begins(chain):
    done = shell("python -m tactile_assets.fresh", chain.home)
    assert done.returncode == 1 and done.stdout.startswith("Made with another configuration")


def test_what_was_configured_for_an_asset_that_a_run_did_not_make_counts_for_none(platform):
    """Dagster takes it, and it has no effect."""
    job = dg.Definitions([outlines, masks]).get_implicit_global_asset_job_def()
    run = job.execute_in_process(
        {"ops": {"masks": {"config": {"resolution": 32}}}},
        asset_selection=[outlines.key], instance=platform.instance,
    )  # fmt: skip
    assert run.success and run.dagster_run.run_config
    assert not configured(platform.instance, "outlines")


@dg.asset(config_schema={"resolution": int})
def masks() -> int:
    return 0


@dg.asset
def outlines() -> int:
    return 0


@pytest.mark.parametrize(
    ("address", "said"),
    [("", "TACTILE_POSTGRES"), ("postgresql://u:hush@127.0.0.1:1/db", "psycopg"), ("nowhere", "")],
)
def test_records_that_cannot_be_opened_are_told_in_one_line(tmp_path, monkeypatch, address, said):
    home = tmp_path / "dagster"
    home.mkdir()
    shutil.copy(REPOSITORY / "deploy" / "dagster.yaml", home)
    monkeypatch.setenv("DAGSTER_HOME", str(home))
    monkeypatch.setenv("TACTILE_POSTGRES", address)
    if not address:
        monkeypatch.delenv("TACTILE_POSTGRES")
    with (
        pytest.raises(TactileError, match=f"cannot be opened as .*{said}") as refused,
        own_instance(),
    ):
        pass
    assert "hush" not in str(refused.value) and "\n" not in str(refused.value)


def test_a_full_disk_under_the_records_is_told_in_one_line(tmp_path, no_records, monkeypatch):
    with small_disk(tmp_path / "small", kilobytes=4000) as fill:
        home = shutil.copytree(no_records, tmp_path / "small" / "dagster")
        monkeypatch.setenv("DAGSTER_HOME", str(home))
        fill()
        said = r"records in .* \(.*disk.*\): make room"
        with pytest.raises(TactileError, match=said), own_instance() as instance:
            instance.create_run_for_job(nothing)


def test_records_that_cannot_be_read_are_told_in_one_line(tmp_path, no_records):
    shutil.copytree(no_records, tmp_path / "dagster")
    (tmp_path / "dagster" / "history" / "runs.db").write_text("no database")
    done = shell("python -m tactile_assets.fresh", tmp_path)
    assert done.returncode == 1
    [line] = done.stderr.splitlines()
    assert line.startswith(f"Error: Dagster's records in {tmp_path}/dagster cannot be read or")
    assert line.endswith("(file is not a database): make room, or mend that")
