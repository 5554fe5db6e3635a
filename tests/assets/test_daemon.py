"""A real daemon, for a while: what runs by itself does."""

import json
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import ClassVar

import dagster as dg
import pytest
from dagster import DagsterRunStatus
from dagster._core.scheduler.instigation import InstigatorState, InstigatorStatus

from tactile_assets.runs import UNFINISHED, tags_of
from tactile_core.processes import Worker
from tests.assets.running import Platform, begin, nothing, until
from tests.core.dataset.mesh_files import make_zip, obj
from tests.object_store import BUCKET, object_store

SOON = 240  # seconds, several times what each step takes


class Server(SimpleHTTPRequestHandler):
    """Serves a folder, and keeps what is posted to it."""

    posted: ClassVar[list[tuple[str, dict]]] = []

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers["Content-Length"]))
        self.posted.append((self.path, json.loads(body)))
        self.send_response(200)
        self.end_headers()

    def log_message(self, format, *args) -> None:
        pass


@dataclass
class Day:
    """What a daemon did: the runs, what the webhook was told, and what the daemon said."""

    platform: Platform
    dead: str
    posted: list[tuple[str, dict]]
    said: str

    def run(self, tag: str, value: str | None = None) -> dg.DagsterRun:
        """The first run with this tag."""
        runs = self.platform.instance.get_runs()[::-1]
        return next(run for run in runs if value in (None, run.tags.get(tag)) and tag in run.tags)


@pytest.fixture(scope="module")
def day(tmp_path_factory) -> Iterator[Day]:
    """A dead run is there as the daemon starts. Then every source changes at once, the clock
    strikes, new policies come, and at last an archive breaks."""
    home, site = tmp_path_factory.mktemp("home"), tmp_path_factory.mktemp("site")
    (home / "dagster").mkdir()
    for number in (1, 2):
        make_zip(site / f"{number}.zip", {"a/model.obj": obj(number)})
    shutil.copy(site / "1.zip", site / "bottle.zip")
    (site / "mug").mkdir()
    (site / "mug" / "a.obj").write_bytes(obj())
    with (
        dg.DagsterInstance.from_config(str(home / "dagster")) as instance,
        pytest.MonkeyPatch.context() as patch,
    ):
        dead = dead_run(instance)
        with object_store(patch) as s3, serving(site) as web:
            s3.put("can.zip", (site / "1.zip").read_bytes())
            classes = {
                "mug": f"{site}/mug",
                "bottle": f"{web}/bottle.zip",
                "can": f"s3://{BUCKET}/can.zip",
            }
            with daemon(
                home,
                TEST_CLASSES=json.dumps(classes),
                TACTILE_CRON="* * * * *",
                TACTILE_WEBHOOK=f"{web}/secret",
                DAGSTER_GRPC_TIMEOUT_SECONDS=str(SOON),  # runs that begin later than that fail
                **s3.variables,
            ) as log:

                def comes(condition: Callable[[], object]) -> None:
                    until(condition, SOON, lambda: f"The daemon said:\n{log.read_text()[-9000:]}")

                comes(lambda: "the source is remembered" in log.read_text())
                s3.put("can.zip", (site / "2.zip").read_bytes())
                shutil.copy(site / "2.zip", site / "bottle.zip")
                (site / "mug" / "b.obj").write_bytes(obj(2))
                comes(lambda: asked_for(instance, "dagster/schedule_name"))
                # On a slow machine these would become more by the minute.
                weekly = state(instance, "weekly")
                instance.update_instigator_state(weekly.with_status(InstigatorStatus.STOPPED))
                comes(lambda: succeeded(instance, "tactile/changed"))
                comes(lambda: succeeded(instance, "dagster/schedule_name"))
                comes(lambda: not unfinished(instance))
                # Policies are not followed where it meets them together with newer evaluations.
                over = time.time()
                comes(lambda: has_looked(instance, "refresh_evaluations", over))
                instance.report_runless_asset_event(dg.AssetMaterialization("policies"))
                comes(lambda: succeeded(instance, "dagster/from_automation_condition"))
                (site / "bottle.zip").write_bytes(b"PK\x03\x04 and then nothing")
                comes(lambda: any("bottle.zip" in text["text"] for _, text in Server.posted))
                comes(lambda: not unfinished(instance))
        yield Day(Platform(home, instance), dead, Server.posted, log.read_text())


@contextmanager
def daemon(home: Path, **variables: str) -> Iterator[Path]:
    """A daemon at work; yields the file with what it says, and what its runs say."""
    log = home / "daemon.log"
    log.touch()
    command = f"dagster-daemon run -m tests.assets.daemon_platform > {log} 2>&1"
    with begin(command, home, **variables) as process:
        try:
            yield log
        finally:
            process.terminate()
            try:
                process.wait(SOON)
            finally:
                process.kill()


@contextmanager
def serving(folder: Path) -> Iterator[str]:
    """The address of a server of this folder."""
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Server, directory=str(folder))) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


def dead_run(instance: dg.DagsterInstance) -> str:
    """A run that is under way, of a process that is no more."""
    with subprocess.Popen(["sleep", "60"]) as process:
        worker = Worker.of(process.pid)
        process.kill()
    run = instance.create_run_for_job(nothing, status=DagsterRunStatus.STARTED)
    instance.add_run_tags(run.run_id, tags_of(worker, run.run_id))
    return run.run_id


def asked_for(instance: dg.DagsterInstance, tag: str, *statuses: DagsterRunStatus) -> bool:
    """Whether there is a run with this tag, in one of `statuses` where there are any."""
    runs = instance.get_runs(dg.RunsFilter(statuses=statuses))
    return any(tag in run.tags for run in runs)


def succeeded(instance: dg.DagsterInstance, tag: str) -> bool:
    return asked_for(instance, tag, DagsterRunStatus.SUCCESS)


def unfinished(instance: dg.DagsterInstance) -> list[dg.DagsterRun]:
    """The runs that wait or are under way."""
    waiting = [DagsterRunStatus.NOT_STARTED, DagsterRunStatus.QUEUED]
    return list(instance.get_runs(dg.RunsFilter(statuses=[*waiting, *UNFINISHED])))


def state(instance: dg.DagsterInstance, name: str) -> InstigatorState:
    """How it stands with a schedule or sensor that the daemon has looked at."""
    [found] = [one for one in instance.all_instigator_state() if one.instigator_name == name]
    return found


def has_looked(instance: dg.DagsterInstance, name: str, since: float) -> bool:
    """Whether a sensor has begun to look after this time, and is done."""
    sensor = state(instance, name)
    ticks = instance.get_ticks(sensor.instigator_origin_id, sensor.selector_id, after=since)
    return any(tick.end_timestamp for tick in ticks)


def test_a_dead_run_does_not_keep_others_from_being_launched(day):
    """The limit is one run at a time, and others were launched."""
    run = day.platform.instance.get_run_by_id(day.dead)
    assert run.status == DagsterRunStatus.FAILURE


def test_the_schedule_fires_when_it_is_told_to_and_the_run_succeeds(day):
    run = day.run("dagster/schedule_name", "weekly")
    assert run.job_name == "whole_chain" and run.is_success


def test_a_changed_folder_archive_and_object_ask_for_a_run(day):
    run = day.run("tactile/changed")
    assert run.tags["tactile/changed"] == "bottle, can, mug"
    assert run.is_success and run.tags["dagster/sensor_name"] == "source_changes"


def test_evaluations_follow_new_policies(day):
    run = day.run("dagster/from_automation_condition")
    assert run.asset_selection == {dg.AssetKey("rollouts")}
    assert run.is_success


def test_a_failure_reaches_the_webhook_with_its_reason_and_the_address_no_log(day):
    told = [(path, text["text"]) for path, text in day.posted if "bottle.zip" in text["text"]]
    assert told[0][0] == "/secret"
    first, second = told[0][1].splitlines()
    assert first.startswith("Tactile exploration: whole_chain failed on ")
    assert second.startswith("shapenet_meshes: ")
    assert "/secret" not in day.said
    logs = day.platform.home / "dagster"
    for file in logs.rglob("*"):
        assert not file.is_file() or b"/secret" not in file.read_bytes(), file
