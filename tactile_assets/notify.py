"""What went wrong reaches people: messages to the webhook that TACTILE_WEBHOOK names.

What is to be told is first kept as a file in the home: an answer may be long in coming, and Dagster
shows a sensor no run twice.
"""

import os
import socket
from collections.abc import Sequence
from pathlib import Path

import dagster as dg
import requests

from tactile_assets.automation import HALF_A_MINUTE
from tactile_assets.console import event_text, reason, short_name
from tactile_assets.resources import Store
from tactile_core.errors import OutOfReachError, TactileError
from tactile_core.files import written_whole

VARIABLE = "TACTILE_WEBHOOK"
FOLDER = "messages"  # in the home
NO_ADDRESS = (requests.exceptions.MissingSchema, requests.exceptions.InvalidSchema,
              requests.exceptions.InvalidURL)  # fmt: skip
LONGEST = 3000  # letters of a message: longer ones are refused here and there, now and later


@dg.run_failure_sensor(
    monitor_all_code_locations=True,  # runs of the command line belong to none
    default_status=dg.DefaultSensorStatus.RUNNING,
    minimum_interval_seconds=HALF_A_MINUTE,
    description=f"Has `messages` tell the webhook that {VARIABLE} names of every run that fails.",
)
def failed_runs(context: dg.RunFailureSensorContext) -> dg.SkipReason | None:
    """Which run failed where, and why: a line for each step that failed, and for each check."""
    run = context.dagster_run
    lines = []
    for event in context.get_step_failure_events():
        error = event.step_failure_data.error
        lines.append(f"{short_name(event.step_key or '')}: {reason(error)}")
    lines += failed_verdicts(context.instance, run.run_id)
    said = [context.failure_event.message or "no step says why"]
    return keep(run, "failed", lines or said)


@dg.run_status_sensor(
    run_status=dg.DagsterRunStatus.SUCCESS,
    monitor_all_code_locations=True,
    default_status=dg.DefaultSensorStatus.RUNNING,
    minimum_interval_seconds=HALF_A_MINUTE,
    description="The same of every run that succeeds with a check that does not pass as an error.",
)
def failed_checks(context: dg.RunStatusSensorContext) -> dg.SkipReason | None:
    """Which checks did not pass, and why."""
    lines = failed_verdicts(context.instance, context.dagster_run.run_id)
    return keep(context.dagster_run, "succeeded with failed checks", lines) if lines else None


@dg.sensor(
    minimum_interval_seconds=HALF_A_MINUTE,
    default_status=dg.DefaultSensorStatus.RUNNING,
    description=f"Tells the webhook that {VARIABLE} names what is to be told, until it takes it.",
)
def messages(context: dg.SensorEvaluationContext) -> dg.SkipReason:
    """The only one that sends what is kept, so that nothing is sent twice."""
    address, waiting = os.environ.get(VARIABLE), kept()
    if not (address and waiting):
        return dg.SkipReason("there is nothing to tell, or nobody")
    deliver(address, waiting)
    return dg.SkipReason(f"{len(waiting)} messages told")


def failed_verdicts(instance: dg.DagsterInstance, run_id: str) -> list[str]:
    """A line for each check of a run that did not pass, but for mere warnings."""
    lines = []
    for entry in instance.all_logs(run_id, of_type=dg.DagsterEventType.ASSET_CHECK_EVALUATION):
        event = entry.get_dagster_event()
        verdict = event.asset_check_evaluation_data
        if not verdict.passed and verdict.severity == dg.AssetCheckSeverity.ERROR:
            lines.append(f"{verdict.asset_key.to_user_string()}: {event_text(event)}")
    return lines


def keep(run: dg.DagsterRun, became: str, lines: Sequence[str]) -> dg.SkipReason | None:
    """Keep for `messages` what became of a run, and why, or tell it at once where nothing can be
    kept; it is sent as Slack's JSON, which Mattermost and others take too."""
    address = os.environ.get(VARIABLE)
    if not address:
        return dg.SkipReason(f"{VARIABLE} names no webhook")
    what = "a run of some assets" if run.job_name.startswith("__") else run.job_name
    head = f"Tactile exploration: {what} {became} on {socket.gethostname()} (run {run.run_id})"
    text = "\n".join([head, *lines])
    text = text if len(text) <= LONGEST else f"{text[:LONGEST]} …"
    try:
        with written_whole(folder() / f"{run.run_id}.txt") as file:
            file.write(text.encode())
    except (OSError, TactileError):  # where the disk is full, runs fail
        send(address, text)
    return None


def kept() -> list[Path]:
    """What is to be told, the oldest first."""
    return sorted(folder().glob("*.txt"), key=lambda file: file.stat().st_mtime)


def folder() -> Path:
    return Path(Store.from_environment().home, FOLDER)


def deliver(address: str, waiting: Sequence[Path]) -> None:
    """Send messages, and forget each as it is taken. One that is refused does not hold up those
    after it; a webhook that is out of reach is left alone."""
    refusal = None
    for file in waiting:
        try:
            send(address, file.read_text())
        except OutOfReachError:
            raise
        except TactileError as error:
            refusal = error
        else:
            file.unlink()
    if refusal:
        raise refusal


def send(address: str, text: str) -> None:
    """Post a message; raises `OutOfReachError` where a later try may help.

    The address is a secret, and `requests` names it in its errors: none goes on from here.
    """
    status = 0
    try:
        # Led elsewhere, what is posted would be asked for instead, and any page be an answer.
        answer = requests.post(address, json={"text": text}, timeout=10, allow_redirects=False)
        status, said = answer.status_code, f"status {answer.status_code}"
    except NO_ADDRESS as error:
        status, said = 400, type(error).__name__
    except requests.RequestException as error:
        said = type(error).__name__
    if status == 429 or status >= 500 or not status:
        raise OutOfReachError(
            f"the webhook of {VARIABLE} takes no message now ({said}): it is tried again"
        )
    if 300 <= status < 400:
        said += ", a redirect"
    if not 200 <= status < 300:
        raise TactileError(f"the webhook of {VARIABLE} takes no message ({said}): correct it")
