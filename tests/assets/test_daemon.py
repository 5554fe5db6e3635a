"""A real daemon, for a while: what runs by itself does."""

import json
import os
import shutil
import subprocess
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread
from typing import ClassVar

import dagster as dg
import pytest
from dagster import DagsterRunStatus
from moto.server import ThreadedMotoServer

from tactile_assets.runs import tags_of
from tactile_core.processes import Worker
from tests.assets.running import Platform, begin, nothing, until
from tests.core.dataset.mesh_files import make_zip, obj

pytestmark = pytest.mark.skipif(
    not os.environ.get("TACTILE_TESTS_DAEMON"),
    reason="takes minutes of a machine of its own: set TACTILE_TESTS_DAEMON=1",
)

SUCCESS = dg.RunsFilter(statuses=[DagsterRunStatus.SUCCESS])


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
    """A dead run is there as the daemon starts. Then every source changes at once, new policies
    come, the clock strikes, and at last an archive breaks."""
    home, site = tmp_path_factory.mktemp("home"), tmp_path_factory.mktemp("site")
    (home / "dagster").mkdir()
    for number in (1, 2):
        make_zip(site / f"{number}.zip", {"a/model.obj": obj(number)})
    shutil.copy(site / "1.zip", site / "bottle.zip")
    (site / "mug").mkdir()
    (site / "mug" / "a.obj").write_bytes(obj())
    s3 = ThreadedMotoServer("127.0.0.1", port=0, verbose=False)
    s3.start()
    host, port = s3.get_host_and_port()
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Server, directory=str(site)))
    Thread(target=server.serve_forever, daemon=True).start()
    web = f"http://127.0.0.1:{server.server_port}"
    amazon = {
        "AWS_ACCESS_KEY_ID": "testing",
        "AWS_SECRET_ACCESS_KEY": "testing",
        "AWS_DEFAULT_REGION": "us-east-1",
        "AWS_ENDPOINT_URL": f"http://{host}:{port}",
    }
    classes = {
        "mug": f"{site}/mug", "bottle": f"{web}/bottle.zip", "can": "s3://bucket/can.zip"
    }  # fmt: skip
    put = bucket(amazon)
    put((site / "1.zip").read_bytes())
    with dg.DagsterInstance.from_config(str(home / "dagster")) as instance:
        platform = Platform(home, instance)
        dead = dead_run(instance)
        daemon = begin(
            "dagster-daemon run -m tests.assets.daemon_platform",
            home,
            TEST_CLASSES=json.dumps(classes),
            TACTILE_CRON="* * * * *",
            TACTILE_WEBHOOK=f"{web}/secret",
            **amazon,
        )
        said: list[str] = []
        assert daemon.stderr is not None and daemon.stdout is not None
        readers = [
            Thread(target=lambda pipe: [said.append(line) for line in pipe], args=[pipe])
            for pipe in (daemon.stderr, daemon.stdout)
        ]
        for reader in readers:
            reader.start()
        day = Day(platform, dead, Server.posted, "")
        try:
            until(lambda: "the source is remembered" in "".join(said))
            put((site / "2.zip").read_bytes())
            shutil.copy(site / "2.zip", site / "bottle.zip")
            (site / "mug" / "b.obj").write_bytes(obj(2))
            until(lambda: succeeded(instance, "tactile/changed"))
            until(lambda: succeeded(instance, "dagster/schedule_name"))
            # From here on no more of these: on a slow machine they become more by the minute.
            until(lambda: without_more(instance) and evaluated(instance))
            (site / "bottle.zip").write_bytes(b"PK\x03\x04 and then nothing")
            until(
                lambda: (
                    without_more(instance)
                    and any("bottle.zip" in text["text"] for _, text in Server.posted)
                )
            )
        finally:
            daemon.terminate()
            daemon.wait()
            for reader in readers:
                reader.join()
            server.shutdown()
            s3.stop()
        day.said = "".join(said)
        yield day


def bucket(amazon: dict[str, str]):
    """What puts the object can.zip into a new bucket."""
    import boto3

    client = boto3.client(
        "s3",
        endpoint_url=amazon["AWS_ENDPOINT_URL"],
        region_name=amazon["AWS_DEFAULT_REGION"],
        aws_access_key_id="testing",
        aws_secret_access_key="testing",
    )
    client.create_bucket(Bucket="bucket")
    return lambda data: client.put_object(Bucket="bucket", Key="can.zip", Body=data)


def dead_run(instance: dg.DagsterInstance) -> str:
    """A run that is under way, of a process that is no more."""
    with subprocess.Popen(["sleep", "60"]) as process:
        tags = tags_of(Worker.of(process.pid))
        process.kill()
    run = instance.create_run_for_job(nothing, status=DagsterRunStatus.STARTED, tags=tags)
    return run.run_id


def evaluated(instance: dg.DagsterInstance) -> bool:
    """Whether an evaluation has followed new policies. If not, there are newer ones: what came
    before the daemon's first look, or while a run was under way, is not followed."""
    instance.report_runless_asset_event(dg.AssetMaterialization("policies"))
    time.sleep(3)
    return succeeded(instance, "dagster/from_automation_condition")


def without_more(instance: dg.DagsterInstance) -> bool:
    """Cancel the runs of the schedule that wait."""
    waiting = dg.RunsFilter(
        statuses=[DagsterRunStatus.QUEUED], tags={"dagster/schedule_name": "weekly"}
    )
    for run in instance.get_runs(waiting):
        instance.report_run_canceled(run)
    return True


def succeeded(instance: dg.DagsterInstance, tag: str) -> bool:
    return any(tag in run.tags for run in instance.get_runs(SUCCESS))


def test_a_dead_run_does_not_keep_others_from_being_launched(day):
    """The limit is one run at a time, and others were launched."""
    run = day.platform.instance.get_run_by_id(day.dead)
    assert run.status == DagsterRunStatus.FAILURE


def test_the_schedule_fires_every_minute_as_it_is_told_and_the_run_succeeds(day):
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
