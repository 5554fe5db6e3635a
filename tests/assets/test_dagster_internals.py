"""Where Dagster changes under us, these say what breaks."""

import inspect

import dagster as dg
from dagster._core.execution import context_creation_job

from tactile_assets.console import console


def test_runs_without_loggers_of_their_own_print_one_line_a_message():
    """Else `make run` prints Dagster's own console: every event, and failures with their stacks."""
    assert "default_system_loggers(" in inspect.getsource(context_creation_job.create_log_manager)
    with dg.DagsterInstance.ephemeral() as instance:
        assert context_creation_job.default_system_loggers(instance) == [(console, {})]
