"""What assets say of themselves: who owns them, and what they stored."""

import math
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import dagster as dg
import pandas as pd
from upath import UPath

from tactile_assets.columns import column_schema, kind
from tactile_core.parquet import table_hash

OWNERS = ["team:tactile-exploration"]
SECTION = {
    "dataset": {"section": "IV"},
    "reconstruction": {"section": "V"},
    "exploration": {"section": "VI"},
    "evaluation": {"section": "VII"},
}


def wing(group: str, io_manager: str = "tables") -> dict[str, Any]:
    """What all assets of a wing say alike: their group and its section of the report, their owners,
    and how they are stored."""
    return {
        "group_name": group,
        "tags": SECTION[group],
        "owners": OWNERS,
        "io_manager_key": io_manager,
    }


def curves_at(work: Path | UPath) -> dict[str, dg.PathMetadataValue]:
    """Where the curves of a training lie for TensorBoard; nothing where its work lies in an object
    store, as they then stay with the node that trained."""
    return {"tensorboard": dg.MetadataValue.path(work)} if isinstance(work, Path) else {}


def shown(table: pd.DataFrame, meanings: Mapping[str, str] | None = None) -> dg.TableMetadataValue:
    """A small table as the UI shows it, with "-" for what is missing.

    meanings : column → what it means, where the name alone does not say it
    """
    meanings = meanings or {}
    columns = [
        dg.TableColumn(str(name), type=kind(column), description=meanings.get(str(name)))
        for name, column in table.items()
    ]
    records = [
        dg.TableRecord({str(name): cell(value) for name, value in row.items()})
        for row in table.to_dict("records")
    ]
    return dg.MetadataValue.table(records, schema=dg.TableSchema(columns))


def cell(value: Any) -> str | int | float:
    """A value as JSON has it: NumPy's as Python's, a float with four digits, nothing as "-"."""
    value = value.item() if hasattr(value, "item") else value
    if pd.isna(value):
        return "-"
    if isinstance(value, float):
        return float(f"{value:.4g}")
    return value if isinstance(value, int) else str(value)


def counts(table: pd.DataFrame, rows: str, columns: str) -> dg.TableMetadataValue:
    """How many rows of `table` there are for each pair of values, as a small table."""
    crossed = pd.crosstab(table[rows], table[columns], margins=True, margins_name="all")
    return shown(crossed.reset_index())


def number(value: float) -> dg.FloatMetadataValue:
    """A number with six digits, a float even where it is whole: the UI plots it over runs."""
    return dg.MetadataValue.float(float(f"{value:.6g}"))


def numbers(name: str, of: pd.Series) -> dict[str, dg.FloatMetadataValue]:
    """A number for each entry, as `name/entry`; one that is not defined is left out."""
    return {f"{name}/{entry}": number(value) for entry, value in of.items() if math.isfinite(value)}


def seconds_since(began: float) -> dg.FloatMetadataValue:
    """The seconds since `began`, which `time.perf_counter` said; kept work takes hardly any."""
    return number(time.perf_counter() - began)


def table_version(table: pd.DataFrame) -> str:
    """The data version of an asset's table, made or read again: numbers with gaps are floats there.

    A column `key` says how its rows were made, not what they are, and does not count.
    """
    gaps = [name for name, cells in table.items() if isinstance(cells.dtype, pd.Int64Dtype)]
    return table_hash(table.drop(columns="key", errors="ignore").astype(dict.fromkeys(gaps, float)))


def stored(
    table: pd.DataFrame, meanings: Mapping[str, str], **metadata: Any
) -> dg.MaterializeResult:
    """A table as the value of its asset; the hash of its content is the data version.

    meanings : column → description
    """
    return dg.MaterializeResult(
        value=table,
        data_version=dg.DataVersion(table_version(table)),
        metadata={
            **metadata,
            "dagster/row_count": len(table),
            "dagster/column_schema": column_schema(table, meanings),
        },
    )


def set_aside(manifest: pd.DataFrame) -> dict[str, Any]:
    """How many meshes could not be used, why the first of them, and what their sources held."""
    aside = manifest.loc[manifest["status"] != "ok", ["model_id", "category", "status"]]
    reasons = {"meshes_set_aside": shown(aside.head(20))} if len(aside) else {}
    held = manifest.attrs.get("sources")
    sources = {"held_by_the_source": shown(pd.DataFrame(held))} if held else {}
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
