"""What is old goes, and nothing that a stored asset needs."""

import os
import shutil
import time

import dagster as dg
import pytest
from dagster import DagsterRunStatus
from fsspec.implementations.local import LocalFileSystem

from tactile_assets.dagster_internals import stale_assets
from tactile_assets.definitions import defs
from tactile_assets.io_managers import PolicyIndex
from tactile_assets.prune import find_old, prune
from tactile_core.dataset.meshes import DOWNLOADS
from tactile_core.dataset.sources.cache import cache_path
from tactile_core.errors import TactileError
from tactile_core.parquet import read_table
from tactile_core.reconstruction.trained import load_unet
from tactile_core.settings import PruneSettings
from tests.assets.running import ALL, Platform, nothing
from tests.shared import copied

EVERYTHING = PruneSettings(days=0, runs=0)


@pytest.fixture
def aged(chain, tmp_path) -> Platform:
    """The home of the finished run, copied, with what an earlier life would have left in it."""
    home = tmp_path / "home"
    copied(chain.home, home, symlinks=True)
    with dg.DagsterInstance.from_config(str(home / "dagster")) as instance:
        platform = Platform(home, instance)
        for status in (DagsterRunStatus.FAILURE, DagsterRunStatus.STARTED):
            run = instance.create_run_for_job(nothing, status=status)
            instance.report_engine_event("something was said", run)
            (platform.store.path("steps", run.run_id)).mkdir(parents=True)
            (platform.store.path("steps", run.run_id) / "plan.json").write_text("{}")
        shutil.copytree(home / "artifacts/policies/total-0", home / "artifacts/policies/total-9")
        (home / "artifacts/figures/of_an_asset_that_was.png").write_bytes(b"")
        download = cache_path("https://example.org/model.zip", home / "cache" / DOWNLOADS)
        download.write_bytes(b"a download")
        (home / "cache/unet/tensorboard").mkdir(parents=True, exist_ok=True)
        (home / "cache/unet/checkpoint.pt").write_bytes(b"")
        yield platform


def told(platform: Platform, settings: PruneSettings) -> list[str]:
    lines: list[str] = []
    prune(platform.instance, platform.store, settings, lines.append)
    return lines


def test_after_everything_old_is_gone_every_asset_loads_and_none_is_stale(aged):
    failed, under_way = aged.instance.get_runs()[1].run_id, aged.instance.get_runs()[0].run_id
    before = stale_assets(aged.instance, defs, ALL)
    told(aged, EVERYTHING)
    for asset in ALL:
        if asset not in ("unet", "policies"):
            assert len(read_table(aged.store.path(f"{asset}.parquet")))
    assert load_unet(aged.store.path("unet")).weights
    index = PolicyIndex(base_path=aged.store.path())
    stored = index.load_from_path(dg.build_input_context(), aged.store.path("policies"))
    assert {path.name for path in stored} == {"total-0", "gain-0"}
    assert stale_assets(aged.instance, defs, ALL) == before
    assert not aged.instance.has_run(failed) and aged.instance.has_run(under_way)
    assert not (aged.home / "dagster" / "history" / "runs" / f"{failed}.db").exists()
    assert aged.store.stored_steps() == {under_way}
    for gone in ("policies/total-9", "figures/of_an_asset_that_was.png", "../cache/unet"):
        assert not (aged.home / "artifacts" / gone).exists()
    kept = cache_path("https://example.org/model.zip", aged.home / "cache" / DOWNLOADS)
    assert kept.read_bytes() == b"a download"
    assert (aged.home / "artifacts/figures/figure_4.png").exists()
    assert find_old(aged.instance, aged.store, EVERYTHING) == []


def test_figures_stay_where_another_home_stored_an_asset_that_these_records_do_not_know(aged):
    artifacts = aged.home / "artifacts"
    shutil.copy(artifacts / "rollouts.parquet", artifacts / "attainable_evaluation.parquet")
    theirs = artifacts / "figures" / "attainable_figure_4.png"
    theirs.write_bytes(b"")
    told(aged, EVERYTHING)
    assert theirs.exists() and (artifacts / "figures" / "figure_4.png").exists()


def test_figures_stay_where_the_records_were_lost(aged, platform):
    lost = Platform(aged.home, platform.instance)
    assert "figure" not in {old.kind for old in find_old(lost.instance, lost.store, EVERYTHING)}


def test_what_may_not_be_removed_keeps_nothing_else(aged, monkeypatch):
    """As where a container ran as another user."""
    work = aged.home / "cache" / "unet"
    remove = LocalFileSystem.rm

    def refuses(self, path, **options):
        if str(path) == str(work):
            raise PermissionError(13, "Permission denied", str(work))
        remove(self, path, **options)

    monkeypatch.setattr(LocalFileSystem, "rm", refuses)
    before = {old.name for old in find_old(aged.instance, aged.store, EVERYTHING)}
    lines: list[str] = []
    with pytest.raises(TactileError, match=r"1 things could not .* work unet .*Permission"):
        prune(aged.instance, aged.store, EVERYTHING, lines.append)
    assert {line.split()[1] for line in lines[:-1]} == before - {"unet"}
    assert [old.name for old in find_old(aged.instance, aged.store, EVERYTHING)] == ["unet"]


def test_a_dry_run_lists_what_would_go_with_sizes_and_removes_nothing(aged):
    files = sorted(aged.home.rglob("*"))
    lines = told(aged, EVERYTHING.model_copy(update={"dry_run": True}))
    assert {line.split()[0] for line in lines[:-1]} == {"run", "steps", "policy", "figure", "work"}
    assert all(line.endswith(" MB") for line in lines)
    assert "would be removed" in lines[-1]
    assert sorted(aged.home.rglob("*")) == files


def test_with_a_damaged_index_of_policies_nothing_goes(aged):
    index = aged.store.path("policies", "index.json")
    index.write_text(index.read_text()[:-3])
    with pytest.raises(TactileError, match="materialise policies"):
        told(aged, EVERYTHING)
    assert aged.store.path("policies", "total-9").exists()
    assert aged.store.path("figures", "of_an_asset_that_was.png").exists()


def test_what_is_young_stays_and_so_do_the_last_runs(aged):
    kinds = {old.kind for old in find_old(aged.instance, aged.store, PruneSettings(days=1))}
    assert kinds == {"steps"}
    a_day_ago = time.time() - 25 * 3600
    os.utime(aged.home / "artifacts/figures/of_an_asset_that_was.png", (a_day_ago, a_day_ago))
    kinds = {old.kind for old in find_old(aged.instance, aged.store, PruneSettings(days=1))}
    assert kinds == {"steps", "figure"}
    kinds = {old.kind for old in find_old(aged.instance, aged.store, PruneSettings(days=0))}
    assert "run" not in kinds
