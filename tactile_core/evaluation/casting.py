"""The rays of one policy on some of the shapes to test on, which a run that is killed keeps."""

import contextlib
import threading
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

from tactile_core.dataset.shapes import Shapes
from tactile_core.errors import TactileError
from tactile_core.exploration.policies.base import Policy
from tactile_core.exploration.world.state import Explorations
from tactile_core.files import read_table, write_table
from tactile_core.keys import work_key
from tactile_core.reconstruction.inference import Reconstructor
from tactile_core.settings import RolloutSettings


@dataclass(frozen=True)
class Casting:
    """The rollouts of one policy by one choice."""

    policy: Policy
    choice: str
    key: str

    @property
    def name(self) -> str:
        return f"{self.policy.name} (seed {self.policy.seed}, {self.choice})"


@dataclass
class Part:
    """The rollouts of a casting on some of the test samples, and how far they are, 0–1."""

    casting: Casting
    samples: slice
    done: float = 0.0
    stop: threading.Event = field(default_factory=threading.Event)


def joined(parts: Mapping[int, pd.DataFrame]) -> pd.DataFrame:
    """Parts by their first sample as one table, ray by ray, each in the order of the samples."""
    table = pd.concat([parts[start] for start in sorted(parts)])
    return table.sort_values("ray", kind="stable", ignore_index=True)


def kept(part: Part, work: Path | None, cast: Callable[[], pd.DataFrame]) -> pd.DataFrame:
    """The rows of a part, from `work` if a run that was killed had them there, else newly cast."""
    if work is None:
        return cast()
    samples = f"{part.samples.start}-{part.samples.stop}"
    file = work / f"{work_key(casting=part.casting.key, samples=samples)}.parquet"
    with contextlib.suppress(TactileError):  # it was not cast yet, or is damaged
        table = read_table(file)
        part.done = 1.0
        return table
    table = cast()
    if not part.stop.is_set():
        write_table(table, file)
    return table


def cast_part(
    part: Part, test: Shapes, reconstructor: Reconstructor, settings: RolloutSettings
) -> pd.DataFrame:
    """Its rows in the order of the rays; shapes that have enough of them are left out."""
    casting, policy = part.casting, part.casting.policy
    rng = policy_rng(policy, settings.seed, part.samples.start)
    masks = test.packed[part.samples]
    sample_numbers = np.arange(len(test))[part.samples]
    explorations = Explorations(masks, reconstructor)
    active = np.arange(len(masks))
    tables = []
    for ray in range(1, settings.ray_limit + 1):
        if part.stop.is_set():
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
        part.done = max(held.mean() / settings.count, ray / settings.ray_limit)
        if ray < settings.count:
            continue
        unfinished = np.flatnonzero(explorations.held < settings.count)
        if len(unfinished) == 0:
            break
        if len(unfinished) < len(active):
            active, explorations = active[unfinished], explorations.select(unfinished)
    part.done = 1.0
    return pd.concat(tables, ignore_index=True).assign(key=casting.key)


def policy_rng(policy: Policy, seed: int, sample: int = 0) -> np.random.Generator:
    """A generator of the policy's own, for test samples from number `sample` on: adding a policy
    does not change the others' rows."""
    return np.random.default_rng([seed, policy.seed, zlib.crc32(policy.name.encode()), sample])


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
