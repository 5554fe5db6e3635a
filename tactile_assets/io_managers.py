"""How asset values become files, in formats that a user can open without this code."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import dagster as dg
import pandas as pd
from upath import UPath

from tactile_assets.resources import STEPS
from tactile_assets.trainings import PlannedTraining
from tactile_core.checksums import sealed_json, unsealed_json
from tactile_core.errors import OutOfReachError, TactileError
from tactile_core.files import remove_folder, stored_bytes, written_whole
from tactile_core.parquet import read_table, write_table

if TYPE_CHECKING:
    from tactile_core.reconstruction.trained import TrainedUNet
    from tactile_core.reconstruction.unets import UNets as UNetsBySeed
else:  # Dagster resolves annotations when it loads, and torch takes seconds
    TrainedUNet, UNetsBySeed = Any, dict[int, Any]


@contextmanager
def or_say_how(context: dg.InputContext, path: UPath) -> Iterator[None]:
    """Where nothing is stored at `path`, the error names the command that makes all that the asset
    under way needs."""
    try:
        yield
    except TactileError as error:
        asset = None if path.exists() else asset_under_way(context)
        if asset is None:
            raise
        how = f"dagster asset materialize --select '*{asset}'"
        raise type(error)(f"{error}, or all that {asset} needs: {how}") from error


def asset_under_way(context: dg.InputContext) -> str | None:
    """The asset whose input is loaded; None for a check, or outside of a run."""
    try:
        step = context.step_context
    except dg.DagsterInvariantViolationError:
        return None
    name = step.step.key.partition(".")[0]  # a graph's steps are called asset.step
    assets = {key.to_user_string() for key in step.job_def.asset_layer.executable_asset_keys}
    return name if name in assets else None


class Tables(dg.UPathIOManager):
    """A table as `<asset>.parquet`."""

    extension = ".parquet"

    def dump_to_path(self, context: dg.OutputContext, obj: pd.DataFrame, path: UPath) -> None:
        write_table(obj, path)

    def load_from_path(self, context: dg.InputContext, path: UPath) -> pd.DataFrame:
        with or_say_how(context, path):
            return read_table(path)


class UNets(dg.UPathIOManager):
    """Trained U-Nets by seed, each as a directory of safetensors weights, learning curve and
    settings."""

    def dump_to_path(self, context: dg.OutputContext, obj: UNetsBySeed, path: UPath) -> None:
        from tactile_core.reconstruction.unets import save_unets

        save_unets(obj, path)

    def load_from_path(self, context: dg.InputContext, path: UPath) -> UNetsBySeed:
        from tactile_core.reconstruction.unets import load_unets

        with or_say_how(context, path):
            return load_unets(path)


class PolicyIndex(dg.UPathIOManager):
    """Which policies belong to the asset: given by directory name → version, read as paths."""

    def dump_to_path(self, context: dg.OutputContext, obj: dict[str, str], path: UPath) -> None:
        from tactile_core.exploration.policies.index import write_index

        write_index(path, obj)
        # Not before: a run that could not write it may be executed again from there.
        remove_folder(self._base_path / STEPS / context.run_id)

    def load_from_path(self, context: dg.InputContext, path: UPath) -> list[UPath]:
        from tactile_core.exploration.policies.index import read_index

        with or_say_how(context, path):
            return read_index(path)


class Steps(dg.UPathIOManager):
    """The trainings that the steps inside `policies` hand each other, by run, as JSON.

    They lie in the store, so that steps may run on several machines; `PolicyIndex` removes them.
    """

    extension = ".json"

    def dump_to_path(self, context: dg.OutputContext, obj: PlannedTraining, path: UPath) -> None:
        with written_whole(path) as file:
            file.write(sealed_json(obj))

    def load_from_path(self, context: dg.InputContext, path: UPath) -> PlannedTraining:
        try:
            return unsealed_json(stored_bytes(path), PlannedTraining)
        except OutOfReachError:
            raise
        except (OSError, ValueError) as error:
            state = "missing" if isinstance(error, FileNotFoundError) else "damaged"
            raise TactileError(f"{path} is {state}: materialise policies again") from error

    def get_op_output_relative_path(self, context: dg.InputContext | dg.OutputContext) -> UPath:
        """By run, step and output; a step's brackets would be a pattern to some file systems."""
        parts = [re.sub(r"[^\w.-]+", "-", part) for part in context.get_identifier()]
        return UPath("/".join(parts))


def in_store(kind: type[dg.UPathIOManager], *parts: str) -> dg.IOManagerDefinition:
    """An IO manager of this kind at a place among the artifacts."""

    @dg.io_manager(required_resource_keys={"store"})
    def manager(context: dg.InitResourceContext) -> dg.UPathIOManager:
        return kind(base_path=context.resources.store.path(*parts))

    return manager


IO_MANAGERS = {
    "tables": in_store(Tables),
    "unets": in_store(UNets),
    "policy_index": in_store(PolicyIndex),
    "io_manager": in_store(Steps, STEPS),
}
