"""One tick of everything that runs by itself, on a real instance."""

import contextlib
import os
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path
from typing import NamedTuple

import dagster as dg
import pytest

from tactile_assets import automation, jobs
from tactile_assets.dagster_internals import longest_wait
from tactile_assets.definitions import defs
from tactile_core.errors import TactileError
from tests.assets.running import Platform, shell
from tests.object_store import BUCKET, ObjectStore, object_store

EVALUATIONS = {
    "reconstruction_evaluation", "rollouts", "per_step_evaluation", "per_grasp_evaluation"
}  # fmt: skip


def test_the_schedule_asks_for_the_whole_chain_once_a_week_and_is_off(platform):
    schedule = automation.weekly
    assert schedule.cron_schedule == "0 3 * * 1"
    assert schedule.default_status == dg.DefaultScheduleStatus.STOPPED
    with dg.build_schedule_context(platform.instance) as context:
        tick = schedule.evaluate_tick(context)
    assert len(tick.run_requests) == 1
    queue(platform)
    with dg.build_schedule_context(platform.instance) as context:
        tick = schedule.evaluate_tick(context)
    assert not tick.run_requests and "waits already" in tick.skip_message
    assert schedule.job_name == "whole_chain"
    assert len(defs.resolve_job_def("whole_chain").asset_layer.executable_asset_keys) == 12


def test_a_run_that_was_made_and_never_began_silences_the_schedule_for_minutes_only(
    platform, monkeypatch
):
    """As one does whose process was killed before it began: nobody ends it."""
    queue(platform)
    assert "waits already" in automation.waiting(platform.instance)
    monkeypatch.setattr(automation, "LONGEST_START", timedelta(0))
    assert automation.waiting(platform.instance) == ""


def queue(platform: Platform) -> str:
    """A run of the whole chain that waits for its turn."""
    return platform.instance.create_run_for_job(defs.resolve_job_def("whole_chain")).run_id


def test_the_environment_sets_when_the_schedule_runs(tmp_path):
    code = "from tactile_assets.automation import weekly; print(weekly.cron_schedule)"
    done = shell(f'python -c "{code}"', tmp_path, TACTILE_CRON="30 5 * * *")
    assert done.stdout.strip() == "30 5 * * *", done.stderr


def test_evaluations_are_to_be_fresh_where_a_schedule_was_asked_for(tmp_path):
    asked = (
        "from tactile_assets.definitions import defs; "
        "specs = {spec.key.to_user_string(): spec for spec in defs.resolve_all_asset_specs()}; "
        "print(specs['per_step_evaluation'].freshness_policy is not None)"
    )
    command = f'python -c "{asked}"'
    assert shell(command, tmp_path).stdout.strip() == "False"
    assert shell(command, tmp_path, TACTILE_CRON="0 2 * * *").stdout.strip() == "True"


@pytest.mark.parametrize(
    ("cron", "days"), [("0 2 * * *", 1), ("0 3 * * 1", 7), ("0 0 1 * *", 31), ("0 9 * * 1-5", 3)]
)
def test_the_longest_wait_for_a_tick_is_known(cron, days):
    assert longest_wait(cron) == timedelta(days=days)


def test_jobs_are_parts_of_the_chain():
    assets = {
        job.name: {
            key.path[-1] for key in defs.resolve_job_def(job.name).asset_layer.executable_asset_keys
        }
        for job in jobs.JOBS
    }
    assert assets["evaluate"] == EVALUATIONS
    assert assets["dataset"] | assets["retrain"] == assets["whole_chain"]
    assert not assets["dataset"] & assets["retrain"]
    assert assets["evaluate"] < assets["retrain"]


@pytest.fixture
def source(tmp_path, monkeypatch):
    """A folder of meshes that the sensor watches."""
    for category in ("mug", "bottle"):
        (tmp_path / "meshes" / category).mkdir(parents=True)
        (tmp_path / "meshes" / category / "one.obj").write_text("v 0 0 0\n")
    meshes = automation.PROFILE.meshes.model_copy(update={"location": str(tmp_path / "meshes")})
    profile = automation.PROFILE.model_copy(update={"meshes": meshes})
    monkeypatch.setattr(automation, "PROFILE", profile)
    return tmp_path / "meshes"


def look(platform: Platform, cursor: str | None = None):
    with dg.build_sensor_context(platform.instance, cursor=cursor, definitions=defs) as context:
        return automation.source_changes.evaluate_tick(context)


def look_twice(platform: Platform, cursor: str | None):
    """The second of two ticks."""
    return look(platform, look(platform, cursor).cursor)


def test_the_sensor_asks_for_a_run_only_when_the_source_changes(platform, source):
    first = look(platform)
    assert not first.run_requests and first.cursor
    unchanged = look(platform, first.cursor)
    assert not unchanged.run_requests and "has not changed" in unchanged.skip_message
    (source / "mug" / "two.obj").write_text("v 1 1 1\n")
    changed = look_twice(platform, first.cursor)
    assert len(changed.run_requests) == 1
    assert changed.cursor not in (None, first.cursor)
    assert not look_twice(platform, changed.cursor).run_requests


def test_what_is_being_copied_asks_for_no_run_until_it_stays(platform, source):
    cursor = look(platform).cursor
    for name in ("two", "three"):
        (source / "mug" / f"{name}.obj").write_text("v 1 1 1\n")
        half = look(platform, cursor)
        assert not half.run_requests and "mug changed" in half.skip_message
        cursor = half.cursor
    assert len(look(platform, cursor).run_requests) == 1
    (source / "mug" / "two.obj").unlink()
    (source / "mug" / "three.obj").unlink()
    assert "has not changed" in look(platform, cursor).skip_message


def test_while_a_run_waits_no_other_is_asked_for_and_the_change_not_forgotten(platform, source):
    first = look(platform)
    (source / "mug" / "two.obj").write_text("v 1 1 1\n")
    seen = look(platform, first.cursor)
    run = queue(platform)
    behind = look(platform, seen.cursor)
    assert not behind.run_requests and run in behind.skip_message
    assert behind.cursor in (None, seen.cursor)
    platform.instance.delete_run(run)
    assert len(look(platform, seen.cursor).run_requests) == 1


def test_a_server_that_stops_telling_versions_asks_for_no_run(platform, make_store, monkeypatch):
    """Nor does one that tells them again, unless they are others than those it told before."""
    store = make_store(etag='"1"')
    meshes = automation.PROFILE.meshes.model_copy(update={"classes": {"mug": store.url}})
    profile = automation.PROFILE.model_copy(update={"meshes": meshes})
    monkeypatch.setattr(automation, "PROFILE", profile)
    before = look(platform)
    store.etag = None
    quiet = look(platform, before.cursor)
    assert not quiet.run_requests and "is not watched" in quiet.skip_message
    store.etag = '"1"'
    assert not look(platform, quiet.cursor).run_requests
    store.etag = '"2"'
    [request] = look_twice(platform, quiet.cursor).run_requests
    assert request.tags["tactile/changed"] == "mug"


class OnTheWeb(NamedTuple):
    """An archive that Python's own server offers."""

    file: Path
    address: str

    def put(self, data: bytes, when: int) -> None:
        self.file.write_bytes(data)
        os.utime(self.file, (when, when))

    def remove(self) -> None:
        self.file.unlink()


class InS3(NamedTuple):
    """An archive in a bucket, which notes by itself when it was put there."""

    store: ObjectStore
    address: str

    def put(self, data: bytes, when: int) -> None:
        self.store.put("mugs.zip", data)

    def remove(self) -> None:
        self.store.client.delete_object(Bucket=BUCKET, Key="mugs.zip")


@pytest.fixture(params=["http", "s3"])
def archive(request, site, monkeypatch) -> Iterator[OnTheWeb | InS3]:
    """An archive that is watched, and not there yet."""
    with contextlib.ExitStack() as stack:
        if request.param == "http":
            monkeypatch.setenv("NO_PROXY", "127.0.0.1,localhost")
            found: OnTheWeb | InS3 = OnTheWeb(site.folder / "mugs.zip", f"{site.url}/mugs.zip")
        else:
            found = InS3(stack.enter_context(object_store(monkeypatch)), f"s3://{BUCKET}/mugs.zip")
        classes = {"classes": {"mug": found.address}, "location": None}
        meshes = automation.PROFILE.meshes.model_copy(update=classes)
        profile = automation.PROFILE.model_copy(update={"meshes": meshes})
        monkeypatch.setattr(automation, "PROFILE", profile)
        yield found


def test_an_archive_elsewhere_asks_for_a_run_when_it_is_overwritten_and_only_then(
    platform, archive
):
    absent = look(platform)
    assert not absent.run_requests and archive.address in absent.skip_message
    archive.put(b"first", when=10**9)
    first = look(platform)
    assert not first.run_requests and first.cursor
    assert "has not changed" in look(platform, first.cursor).skip_message
    archive.put(b"other", when=10**9 + 1)  # as long
    changed = look_twice(platform, first.cursor)
    [request] = changed.run_requests
    assert request.tags["tactile/changed"] == "mug"
    second = changed.cursor
    assert not look(platform, second).run_requests
    archive.remove()
    gone = look(platform, second)
    assert not gone.run_requests and "class 'mug'" in gone.skip_message
    assert gone.cursor in (None, second)  # what was seen is not forgotten
    archive.put(b"other", when=10**9 + 1)
    assert "has not changed" in look(platform, second).skip_message
    archive.put(b"third", when=10**9 + 2)
    assert len(look_twice(platform, second).run_requests) == 1


def test_a_cursor_of_another_kind_is_forgotten(platform, source):
    assert not look(platform, "0123456789abcdef").run_requests


def test_a_source_that_has_gone_is_waited_for(platform, source):
    before = look(platform)
    source.rename(source.with_name("elsewhere"))
    gone = look(platform, before.cursor)
    assert not gone.run_requests and str(source) in gone.skip_message
    source.with_name("elsewhere").rename(source)
    assert "has not changed" in look(platform, before.cursor).skip_message


def test_a_server_that_cannot_be_asked_fails_the_tick(platform, monkeypatch):
    meshes = automation.PROFILE.meshes.model_copy(update={"location": "http://127.0.0.1:9/none"})
    profile = automation.PROFILE.model_copy(update={"meshes": meshes})
    monkeypatch.setattr(automation, "PROFILE", profile)
    with pytest.raises(TactileError, match="cannot be asked whether it has changed"):
        look(platform)


def test_the_sensor_says_why_it_has_nothing_to_watch(platform):
    assert "TACTILE_SHAPENET names no source" in look(platform).skip_message


def requested(platform: Platform, cursor=None) -> tuple[set[str], object]:
    """Assets that one tick of the automation conditions asks for, and the tick's cursor."""
    tick = dg.evaluate_automation_conditions(
        defs,
        platform.instance,
        asset_selection=dg.AssetSelection.assets(*EVALUATIONS),
        cursor=cursor,
    )
    keys = {asset for asset in EVALUATIONS if tick.get_num_requested(dg.AssetKey(asset))}
    return keys, tick.cursor


def report(platform: Platform, *assets: str) -> None:
    """Record materialisations, as a run of these assets alone would."""
    for asset in assets:
        platform.instance.report_runless_asset_event(dg.AssetMaterialization(asset))


def test_evaluations_follow_new_policies_and_that_of_the_reconstruction_a_new_unet(platform):
    """Policies are trained with a U-Net: a new one alone has none to cast rays with."""
    everything = [key.path[-1] for key in defs.resolve_asset_graph().get_all_asset_keys()]
    report(platform, *everything)
    _, cursor = requested(platform)
    quiet, cursor = requested(platform, cursor)
    assert quiet == set()
    report(platform, "policies")
    after_policies, cursor = requested(platform, cursor)
    assert after_policies == EVALUATIONS - {"reconstruction_evaluation"}
    report(platform, "rollouts", "per_step_evaluation", "per_grasp_evaluation")
    quiet, cursor = requested(platform, cursor)
    assert quiet == set()
    report(platform, "unet")
    after_unet, _ = requested(platform, cursor)
    assert after_unet == {"reconstruction_evaluation"}


def test_new_splits_alone_make_no_evaluation(platform):
    """Their test split may hold models that the old policies were trained on."""
    report(platform, *(key.path[-1] for key in defs.resolve_asset_graph().get_all_asset_keys()))
    _, cursor = requested(platform)
    report(platform, "rotated_splits", "outlines", "tactile_samples")
    asked, _ = requested(platform, cursor)
    assert asked == set()
