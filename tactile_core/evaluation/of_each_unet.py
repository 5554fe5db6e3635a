"""Rollouts with several U-Nets: the policies of each seed with the U-Net of that seed."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

import pandas as pd
from upath import UPath

from tactile_core.dataset.shapes import Shapes
from tactile_core.evaluation.rollouts import cast_rollouts
from tactile_core.exploration.policies.base import Policy
from tactile_core.exploration.policies.store import describe, load_policies
from tactile_core.finished import forget_stored
from tactile_core.reconstruction.unets import UNets, seed_of
from tactile_core.settings import RolloutSettings


def policies_of_each(directories: Iterable[UPath], unets: UNets) -> dict[int, list[Policy]]:
    """The stored policies that go with each U-Net, by its seed: all with the only one there is.

    Raises `TactileError` where one is missing, damaged, or trained with another.
    """
    places: dict[int, list[UPath]] = {seed: [] for seed in unets}
    for directory in directories:
        places[seed_of(unets, describe(directory).seed)].append(directory)
    return {
        seed: load_policies(places[seed], unet.version(), unet.resolution)
        for seed, unet in unets.items()
    }


def cast_with_each(
    policies: Mapping[int, Sequence[Policy]],
    test: Shapes,
    unets: UNets,
    settings: RolloutSettings,
    previous: pd.DataFrame | None = None,
    progress: Callable[[str], None] = lambda message: None,
    work: Path | None = None,
) -> pd.DataFrame:
    """The rollouts with each U-Net in one table: of the policies that go with it, as
    `policies_of_each` has them, and of the rules, whose seed is that of the U-Net.

    work : keeps what is cast until it is among `previous`, so that a run that was killed, or that
        could not store what it had cast, goes on there
    previous, and the columns of what is returned : as in `cast_rollouts`
    """
    tables: list[pd.DataFrame] = []
    for seed, unet in unets.items():
        if len(unets) > 1:
            progress(f"rollouts: with the U-Net of seed {seed}, {len(tables) + 1} of {len(unets)}")
        tables.append(
            cast_rollouts(
                policies[seed], test, unet, settings, previous, progress,
                work=work, seed_of_references=seed,
            )
        )  # fmt: skip
    table = pd.concat(tables, ignore_index=True)
    forget_stored(table, previous, work)
    return table
