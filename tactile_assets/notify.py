"""A failure reaches people: a message to the webhook that TACTILE_WEBHOOK names."""

import os
import socket
import time

import dagster as dg
import requests

from tactile_assets.console import reason, short_name
from tactile_core.errors import TactileError

VARIABLE = "TACTILE_WEBHOOK"
PAUSES = 1, 4, 0  # seconds after each try


@dg.run_failure_sensor(
    monitor_all_code_locations=True,  # runs of the command line belong to none
    default_status=dg.DefaultSensorStatus.RUNNING,
    minimum_interval_seconds=30,
    description=f"Tells the webhook that {VARIABLE} names of every run that fails.",
)
def failed_runs(context: dg.RunFailureSensorContext) -> dg.SkipReason | None:
    """What is sent is Slack's JSON, which Mattermost and others take too."""
    address = os.environ.get(VARIABLE)
    if not address:
        return dg.SkipReason(f"{VARIABLE} names no webhook")
    send(address, failure(context))
    return None


def failure(context: dg.RunFailureSensorContext) -> str:
    """Which run failed where, and why: a line for it and one for each step that failed."""
    run = context.dagster_run
    what = "a run of some assets" if run.job_name.startswith("__") else run.job_name
    lines = [f"Tactile exploration: {what} failed on {socket.gethostname()} (run {run.run_id})"]
    for event in context.get_step_failure_events():
        error = event.step_failure_data.error
        lines.append(f"{short_name(event.step_key or '')}: {reason(error)}")
    if len(lines) == 1:
        lines.append(context.failure_event.message or "no step says why")
    return "\n".join(lines)


def send(address: str, text: str) -> None:
    """Post a message; tried again where that may help.

    The address is a secret, and `requests` names it in its errors: none goes on from here.
    """
    for pause in PAUSES:
        try:
            answer = requests.post(address, json={"text": text}, timeout=10)
            said = f"status {answer.status_code}"
            if answer.ok or 400 <= answer.status_code < 500:
                break
        except requests.RequestException as error:
            said = type(error).__name__
        time.sleep(pause)
    if said != "status 200":
        raise TactileError(f"the webhook of {VARIABLE} takes no message ({said}): correct it")
