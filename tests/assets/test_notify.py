"""What went wrong is told to the webhook once it takes it, and once only."""

import json
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import dagster as dg
import pytest

from tactile_assets import notify
from tactile_core.errors import OutOfReachError, TactileError
from tests.assets.running import Platform
from tests.disks import small_disk


class Webhook(ThreadingHTTPServer):
    """A server that answers with `status`, but to one text never well, and keeps what it takes."""

    def __init__(self) -> None:
        self.status, self.never, self.taken = 200, "", []
        super().__init__(("127.0.0.1", 0), Answer)

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self.server_port}/secret"


class Answer(BaseHTTPRequestHandler):
    server: Webhook

    def do_POST(self) -> None:
        text = json.loads(self.rfile.read(int(self.headers["Content-Length"])))["text"]
        status = 400 if text == self.server.never else self.server.status
        if 200 <= status < 300:
            self.server.taken.append(text)
        self.send_response(status)
        self.send_header("Location", "/login")
        self.send_header("Content-Length", "0")
        self.end_headers()

    def do_GET(self) -> None:  # the page for whoever is not logged in
        self.send_response(200)
        self.send_header("Content-Length", "0")
        self.end_headers()

    def log_message(self, format, *args) -> None:
        pass


@pytest.fixture
def webhook(platform, monkeypatch) -> Iterator[Webhook]:
    """The one that the environment of the home names."""
    with Webhook() as server:
        threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
        monkeypatch.setenv("TACTILE_HOME", str(platform.home))
        monkeypatch.setenv("DAGSTER_HOME", str(platform.home / "dagster"))
        monkeypatch.setenv("TACTILE_WEBHOOK", server.address)
        monkeypatch.setenv("NO_PROXY", "127.0.0.1")
        yield server
        server.shutdown()


@dg.op
def breaks() -> None:
    raise TactileError("this is why")


@dg.job
def broken() -> None:
    breaks()


@dg.asset
def shapes() -> None:
    pass


def verdict(severity: dg.AssetCheckSeverity) -> dg.AssetChecksDefinition:
    """A check of `shapes` that never passes."""

    @dg.asset_check(asset=shapes)
    def are_round() -> dg.AssetCheckResult:
        return dg.AssetCheckResult(passed=False, severity=severity, description="2 have corners")

    return are_round


class Watch:
    """Ticks of a sensor that watches runs, each from where the last one ended."""

    def __init__(self, platform: Platform, sensor: dg.SensorDefinition) -> None:
        self.platform, self.sensor, self.cursor = platform, sensor, None
        self.tick()

    def tick(self) -> None:
        with dg.build_sensor_context(self.platform.instance, cursor=self.cursor) as context:
            self.cursor = self.sensor.evaluate_tick(context).cursor


def tell(platform: Platform) -> None:
    with dg.build_sensor_context(platform.instance) as context:
        notify.messages.evaluate_tick(context)


def fail(platform: Platform) -> str:
    return broken.execute_in_process(instance=platform.instance, raise_on_error=False).run_id


def test_a_failure_is_told_when_an_outage_is_over_and_once(platform, webhook):
    watch = Watch(platform, notify.failed_runs)
    run = fail(platform)
    watch.tick()
    for status in (503, 429):
        webhook.status = status
        with pytest.raises(OutOfReachError, match=f"status {status}"):
            tell(platform)
    webhook.status = 200
    for _ in range(2):
        watch.tick()
        tell(platform)
    [text] = webhook.taken
    first, second = text.splitlines()
    assert first.startswith("Tactile exploration: broken failed on ") and f"(run {run})" in first
    assert second == "breaks: this is why"


def test_every_failure_of_an_outage_is_told_and_one_that_is_refused_holds_up_no_other(
    platform, webhook
):
    watch = Watch(platform, notify.failed_runs)
    runs = [fail(platform) for _ in range(3)]
    for _ in runs:
        watch.tick()
    first = notify.kept()[0]
    webhook.status, webhook.never = 204, first.read_text()
    with pytest.raises(TactileError, match=r"\(status 400\): correct it"):
        tell(platform)
    assert len(webhook.taken) == 2 and notify.kept() == [first]
    webhook.status, webhook.never = 202, ""
    tell(platform)
    assert sorted(run for run in runs for text in webhook.taken if run in text) == sorted(runs)
    assert notify.kept() == []


def test_a_long_message_is_cut_and_says_so(platform, webhook, monkeypatch):
    monkeypatch.setattr(notify, "LONGEST", 50)
    watch = Watch(platform, notify.failed_runs)
    fail(platform)
    watch.tick()
    tell(platform)
    [text] = webhook.taken
    assert len(text) == 52 and text.endswith(" …")


def test_a_failure_is_told_at_once_where_nothing_can_be_kept(platform, webhook):
    watch = Watch(platform, notify.failed_runs)
    run = fail(platform)
    with small_disk(notify.folder(), kilobytes=100) as fill:
        fill()
        watch.tick()
    [text] = webhook.taken
    assert run in text
    tell(platform)
    assert webhook.taken == [text]


@pytest.mark.parametrize("address", ["hooks.example/x", "ftp://hooks.example/x", "http://[/x"])
def test_an_address_that_never_can_work_is_not_tried_again(address):
    with pytest.raises(TactileError, match=r"takes no message \(\w+\): correct it") as refused:
        notify.send(address, "text")
    assert not isinstance(refused.value, OutOfReachError)
    assert refused.value.__context__ is None  # which has the address


def test_a_redirect_is_no_delivery_and_the_address_in_no_error(webhook):
    webhook.status = 301
    with pytest.raises(TactileError, match=r"\(status 301, a redirect\): correct it") as refused:
        notify.send(webhook.address, "text")
    assert refused.value.__context__ is None


def test_a_server_that_is_not_there_is_tried_again(webhook):
    with pytest.raises(OutOfReachError, match="ConnectionError") as refused:
        notify.send("http://127.0.0.1:9/secret", "text")
    assert refused.value.__context__ is None


def test_a_run_that_succeeds_with_a_failed_check_is_told_and_one_with_a_warning_is_not(
    platform, webhook
):
    watch = Watch(platform, notify.failed_checks)
    for severity in (dg.AssetCheckSeverity.WARN, dg.AssetCheckSeverity.ERROR):
        assert dg.materialize([shapes, verdict(severity)], instance=platform.instance).success
        watch.tick()
    tell(platform)
    [text] = webhook.taken
    first, second = text.splitlines()
    assert " a run of some assets succeeded with failed checks on " in first
    assert second == "shapes: check are_round ERROR not passed: 2 have corners"


def test_where_no_webhook_is_named_nothing_is_kept(platform, webhook, monkeypatch):
    monkeypatch.delenv("TACTILE_WEBHOOK")
    watch = Watch(platform, notify.failed_runs)
    fail(platform)
    watch.tick()
    assert notify.kept() == []
