"""The sources of meshes: waiting for one that is out of reach, and whether it has changed since."""

import contextlib
from collections.abc import Iterator

import dagster as dg

from tactile_assets.provenance import latest
from tactile_core.addresses import shown
from tactile_core.errors import OutOfReachError, TactileError
from tactile_core.settings import MeshSettings

BY_ITSELF = {"dagster/schedule_name", "dagster/sensor_name"}  # tags of a run
FIRST_WAIT = 60.0  # seconds; doubled after every further attempt
ATTEMPTS = 6  # after the first: 63 minutes in all
VERSIONS = "source_versions"  # in the metadata of what was read


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


def versions_read(settings: MeshSettings) -> dict[str, dg.JsonMetadataValue]:
    """Which version of its source each class has, for `news_of` to compare; nothing where meshes
    are generated, or a server does not tell. To be asked before they are read, or a change
    between would be missed."""
    from tactile_core.dataset.sources.watching import source_fingerprint

    try:
        found = source_fingerprint(settings)
    except TactileError:
        return {}  # whoever reads them says it better
    told = found.versions and not found.unwatched
    return {VERSIONS: dg.MetadataValue.json(found.versions)} if told else {}


def news_of(instance: dg.DagsterInstance, asset: str, settings: MeshSettings) -> str:
    """Why the source may hold other meshes than `asset` read, in a sentence; "" where it does not.

    Raises `TactileError` where the source is gone or cannot be asked.
    """
    from tactile_core.dataset.sources.watching import source_fingerprint

    found = source_fingerprint(settings)
    if found.unwatched:
        return f"{found.unwatched[0]}."
    read = latest(instance, asset)[1].metadata.get(VERSIONS)
    same = found.versions == (read.value if read else {})
    return "" if same else f"What {asset} read from {shown(str(settings.location))} has changed."
