"""What a run prints: one line for each message of a step, and one line for each failure.

Dagster's own console prints every event, and every failure with its stacks. Both stay to be
read in the UI.
"""

import logging
import os
from collections.abc import Set
from typing import Any

import dagster as dg

from tactile_assets.config import which_profile

OURS = ("tactile_core.", "tactile_assets.")  # what is raised there is a sentence for the user
WIDTH = 26  # of the longest step name


class OneLine(logging.Formatter):
    """`12:03:04  masks  120/712 rendered`; a record that is not worth a line formats as "".

    Of steps other than those of `assets`, which are checks, only the results are worth one.
    """

    def __init__(self, assets: Set[str]) -> None:
        super().__init__()
        self.assets = assets

    def format(self, record: logging.LogRecord) -> str:
        about: dict[str, Any] = getattr(record, "dagster_meta", {})
        event: dg.DagsterEvent | None = about.get("dagster_event")
        step = short_name(about.get("step_key") or "")
        if event is not None:
            text = event_text(event)
            if event.event_type == dg.DagsterEventType.ASSET_CHECK_EVALUATION:
                step = event.asset_check_evaluation_data.asset_key.to_user_string()
            elif event.is_step_start or event.is_step_success:
                text = text if step.partition("[")[0].partition(".")[0] in self.assets else ""
        elif record.levelno < logging.INFO:
            text = ""
        else:
            text = about.get("orig_message", record.getMessage())
            if text.startswith("Dependencies for step"):  # one line for the failure is enough
                text = ""
            elif record.levelno > logging.INFO:
                text = f"{record.levelname.lower()}: {text}"
        return f"{self.formatTime(record, '%H:%M:%S')}  {step:{WIDTH}}  {text}" if text else ""


def event_text(event: dg.DagsterEvent) -> str:
    """What the console says of a Dagster event; most are not worth a line."""
    data: Any = event.event_specific_data
    match event.event_type:
        case dg.DagsterEventType.RUN_START:
            return which_profile()
        case dg.DagsterEventType.STEP_START:
            return "started"
        case dg.DagsterEventType.STEP_SUCCESS:
            return f"done in {data.duration_ms / 1000:.1f} s"
        case dg.DagsterEventType.STEP_UP_FOR_RETRY:
            return f"failed, tries again: {reason(data.error)}"
        case dg.DagsterEventType.STEP_FAILURE:
            return f"FAILED: {reason(data.error)}"
        case dg.DagsterEventType.RUN_FAILURE if data.first_step_failure_event is None:
            return f"FAILED: {reason(data.error)}" if data.error else event.message or "FAILED"
        case dg.DagsterEventType.ASSET_CHECK_EVALUATION:
            verdict = "passed" if data.passed else f"{data.severity.value} not passed"
            return f"check {data.check_name} {verdict}: {data.description or ''}".rstrip(": ")
    return ""


def reason(error: Any) -> str:
    """The message of an error of ours as it is; of any other its first cause and the place."""
    while error:
        kind, _, message = error.message.strip().partition(": ")
        if kind.startswith(OURS):
            return message
        innermost, error = error, error.cause
    place = innermost.stack[-1].strip().splitlines()[0] if innermost.stack else ""
    return innermost.message.strip() + (f" ({place})" if place else "")


def short_name(step: str) -> str:
    """`policies.train_policy[total_0]` as `policies[total_0]`."""
    asset, _, op = step.partition(".")
    return asset + op[op.find("[") :] if "[" in op else step


@dg.logger
def console(context: dg.InitLoggerContext) -> logging.Logger:
    """One line for each message of a step; failures without their stacks."""
    # While a step runs, Dagster sends file descriptor 2 through a file of its own, and its last
    # lines may never be seen. This copy of the descriptor leads where the run was started.
    handler = logging.StreamHandler(os.fdopen(os.dup(2), "w", buffering=1))
    job = context.job_def
    keys = job.asset_layer.executable_asset_keys if job else set()
    handler.setFormatter(OneLine({key.to_user_string() for key in keys}))
    handler.addFilter(lambda record: bool(handler.format(record)))
    logger = logging.Logger("tactile", level=logging.DEBUG)
    logger.addHandler(handler)
    return logger
