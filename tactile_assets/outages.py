"""A source that is out of reach for a while: a run that began by itself waits until it is back."""

import contextlib
from collections.abc import Iterator

import dagster as dg

from tactile_core.errors import OutOfReachError

BY_ITSELF = {"dagster/schedule_name", "dagster/sensor_name"}  # tags of a run
FIRST_WAIT = 60.0  # seconds; doubled after every further attempt
ATTEMPTS = 6  # after the first: 63 minutes in all


@contextlib.contextmanager
def waited_out(context: dg.AssetExecutionContext) -> Iterator[None]:
    """Have Dagster begin the step again, later and later, where a source did not answer.

    Whoever began the run by hand, and may have misspelt an address, is told at once.
    """
    try:
        yield
    except OutOfReachError as error:
        if BY_ITSELF.isdisjoint(context.run.tags):
            raise
        wait = FIRST_WAIT * 2**context.retry_number
        context.log.warning("%s; the next of %d attempts is in %.0f s", error, ATTEMPTS, wait)
        raise dg.RetryRequested(max_retries=ATTEMPTS, seconds_to_wait=wait) from error
