"""What long work has made stays beside it until whoever asked for it has stored it.

A run may be killed, or its store be full, between the last step of long work and the stored asset.
"""

from pathlib import Path

import pandas as pd
from upath import UPath

from tactile_core.errors import OutOfReachError, TactileError
from tactile_core.files import remove_folder
from tactile_core.parquet import read_table, write_table

TABLE = "finished.parquet"


def finished_table(
    key: str, previous: pd.DataFrame | None, work: Path | UPath
) -> pd.DataFrame | None:
    """The table with this key in its column key, or None where it is still to be made.

    previous : what is stored; where it has the key, `work` is not needed any more and goes
    work : where `keep_finished` may have left it

    Raises `OutOfReachError` where that cannot be looked at: it may be there.
    """
    if previous is not None and has_key(previous, key):
        remove_folder(work)
        return previous
    try:
        table = read_table(UPath(work) / TABLE)
    except OutOfReachError:
        raise
    except TactileError:  # there is none, or it is damaged
        return None
    return table if has_key(table, key) else None


def has_key(table: pd.DataFrame, key: str) -> bool:
    return "key" in table and bool((table["key"] == key).all())


def keep_finished(table: pd.DataFrame, work: Path | UPath) -> None:
    """Keep a table in `work`, and none of what it was made from."""
    folder = UPath(work)
    write_table(table, folder / TABLE)
    for place in list(folder.iterdir()):
        if place.name != TABLE:
            remove_folder(place)


def forget_stored(table: pd.DataFrame, previous: pd.DataFrame | None, work: Path | None) -> None:
    """Remove the parts of a table in `work`, if any, where all of it was stored before, as the keys
    of its rows and of `previous` tell."""
    stored = set() if previous is None else set(previous.get("key", []))
    if work is not None and set(table["key"]) <= stored:
        remove_folder(work)
