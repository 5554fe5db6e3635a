"""The rays of one policy on some of the shapes to test on, which a run that is killed keeps."""

import contextlib
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

from tactile_core.dataset.shapes import Shapes
from tactile_core.errors import TactileError
from tactile_core.exploration.policies.base import Policy, policy_rng
from tactile_core.exploration.world.state import Explorations
from tactile_core.keys import work_key
from tactile_core.parquet import read_table, write_table
from tactile_core.reconstruction.inference import Reconstructor
from tactile_core.settings import RolloutSettings

SAMPLES_AT_A_TIME = 128  # to bound the memory, and what a killed run has to cast again


@dataclass
class Casting:
    """The rollouts of one policy by one choice, and how far they are, 0–1."""

    policy: Policy
    choice: str
    key: str
    done: float = 0.0
    stop: threading.Event = field(default_factory=threading.Event)

    @property
    def name(self) -> str:
        return f"{self.policy.name} (seed {self.policy.seed}, {self.choice})"


def cast_one(
    casting: Casting,
    test: Shapes,
    reconstructor: Reconstructor,
    settings: RolloutSettings,
    work: Path | None,
) -> pd.DataFrame:
    """Its rows in the order of the rays; what `work` keeps of a run that was killed is not cast
    again."""
    portions = list(portions_of(test))
    tables = []
    for number, samples in enumerate(portions):

        def told(share: float, before: int = number) -> None:
            casting.done = (before + share) / len(portions)

        file = file_of(casting, samples, work)
        table = kept(file)
        if table is None:
            table = cast_part(casting, samples, test, reconstructor, settings, told)
            if file and not casting.stop.is_set():
                write_table(table, file)
        tables.append(table)
        told(1)
    return whole(tables)


def portions_of(test: Shapes) -> Iterator[slice]:
    """The samples that are cast at a time."""
    for start in range(0, len(test), SAMPLES_AT_A_TIME):
        yield slice(start, start + SAMPLES_AT_A_TIME)


def file_of(casting: Casting, samples: slice, work: Path | None) -> Path | None:
    """Where `work` keeps some of the rollouts."""
    return work and work / f"{work_key(rollouts=casting.key, samples=repr(samples))}.parquet"


def whole(tables: list[pd.DataFrame]) -> pd.DataFrame:
    """The rollouts of all samples in the order of the rays."""
    return pd.concat(tables).sort_values("ray", kind="stable", ignore_index=True)


def kept(file: Path | None) -> pd.DataFrame | None:
    """What a run that was killed has left; None where there is nothing, or it is damaged."""
    if file is not None:
        with contextlib.suppress(TactileError):
            return read_table(file)
    return None


def cast_part(
    casting: Casting,
    samples: slice,
    test: Shapes,
    reconstructor: Reconstructor,
    settings: RolloutSettings,
    told: Callable[[float], None],
) -> pd.DataFrame:
    """The rollouts on some of the test samples; `told` is told how far they are, 0–1. Shapes that
    have enough rays are left out."""
    policy = casting.policy
    rng = policy_rng(policy, settings.seed, samples.start)
    masks = test.packed[samples]
    sample_numbers = np.arange(len(test))[samples]
    explorations = Explorations(masks, reconstructor)
    active = np.arange(len(masks))
    tables = []
    for ray in range(1, settings.ray_limit + 1):
        if casting.stop.is_set():
            break
        rays = policy.choose(explorations, rng, casting.choice == "likeliest")
        cast = explorations.cast(rays)
        table = sample_columns(casting, test, sample_numbers[active])
        table["ray"] = ray
        table["alpha"], table["beta"] = rays.T.astype(np.int32)
        table["row"], table["column"] = cast.touches.T.astype(np.int16)
        table["missed"], table["repeated"] = cast.missed, cast.repeated
        table["touches"] = explorations.held.copy()
        table["jaccard"] = cast.jaccard.astype(float)
        tables.append(table)
        held = np.full(len(masks), settings.count)
        held[active] = np.minimum(explorations.held, settings.count)
        told(max(held.mean() / settings.count, ray / settings.ray_limit))
        if ray < settings.count:
            continue
        unfinished = np.flatnonzero(explorations.held < settings.count)
        if len(unfinished) == 0:
            break
        if len(unfinished) < len(active):
            active, explorations = active[unfinished], explorations.select(unfinished)
    return pd.concat(tables, ignore_index=True).assign(key=casting.key)


def sample_columns(casting: Casting, test: Shapes, which: np.ndarray) -> pd.DataFrame:
    """The columns that say whose row it is, one row for each of the test samples `which`."""
    return pd.DataFrame(
        {
            "policy": casting.policy.name,
            "seed": casting.policy.seed,
            "choice": casting.choice,
            "sample_id": test.sample_ids[which],
            "model_id": test.model_ids[which],
            "category": test.categories[which],
        }
    )
