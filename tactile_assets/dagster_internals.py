"""What Dagster offers under no public name (1.13.27), in one place.

`tests/assets/test_dagster_internals.py` says what breaks should it change.
"""

import dagster as dg
from dagster._core.execution import context_creation_job


def make_default_console(console: dg.LoggerDefinition) -> None:
    """Make this the console of every run that names no logger of its own.

    Dagster uses the loggers of `Definitions` only where run config names them, and has no setting
    for which ones stand in otherwise.
    """
    context_creation_job.default_system_loggers = lambda instance: [(console, {})]
