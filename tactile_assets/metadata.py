"""What assets say of themselves: who owns them, and what they stored."""

from typing import Any

import dagster as dg
import pandas as pd

from tactile_core.evaluation.tables import markdown_table
from tactile_core.files import table_hash

OWNERS = ["team:tactile-exploration"]


def wing(group: str, io_manager: str = "tables") -> dict[str, Any]:
    """What all assets of a wing say alike: their group, their owners, and how they are stored."""
    return {"group_name": group, "owners": OWNERS, "io_manager_key": io_manager}


def markdown(table: pd.DataFrame, digits: int = 2) -> dg.MarkdownMetadataValue:
    """A small table as the UI shows it."""
    words = table.map(lambda cell: f"{cell:.{digits}f}" if isinstance(cell, float) else str(cell))
    return dg.MetadataValue.md(markdown_table(words))


def counts(table: pd.DataFrame, rows: str, columns: str) -> dg.MarkdownMetadataValue:
    """How many rows of `table` there are for each pair of values, as a small table."""
    crossed = pd.crosstab(table[rows], table[columns], margins=True, margins_name="all")
    return markdown(crossed.reset_index())


def stored(table: pd.DataFrame, **metadata: Any) -> dg.MaterializeResult:
    """A table as the value of its asset; the hash of its content is the data version.

    A column `key` says how its rows were made, not what they are, and does not count.
    """
    version = dg.DataVersion(table_hash(table.drop(columns="key", errors="ignore")))
    return dg.MaterializeResult(value=table, metadata=metadata, data_version=version)


def set_aside(manifest: pd.DataFrame) -> dict[str, Any]:
    """How many meshes could not be used, why the first of them, and what their sources held."""
    aside = manifest.loc[manifest["status"] != "ok", ["model_id", "category", "status"]]
    reasons = {"reasons": markdown(aside.head(20))} if len(aside) else {}
    held = manifest.attrs.get("sources")
    sources = {"sources": markdown(pd.DataFrame(held))} if held else {}
    return {"set_aside": len(aside), **reasons, **sources}


def renewed(table: pd.DataFrame, previous: pd.DataFrame | None, *same: str) -> dict[str, int]:
    """How many rows of `table` are new, and how many are kept from the last one: those that were
    made under the same key, from the same of what the columns `same` name."""
    columns = ["key", *same]
    known = set()
    if previous is not None and {*columns} <= {*previous.columns}:
        known = set(previous[columns].itertuples(index=False, name=None))
    kept = sum(row in known for row in table[columns].itertuples(index=False, name=None))
    return {"new": len(table) - kept, "kept": kept}
