"""Rollouts on a Ray cluster: each policy on some of the samples is a task."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from tactile_core.dataset.shapes import Shapes
from tactile_core.errors import TactileError
from tactile_core.evaluation.casting import Casting, cast_part, file_of, kept, portions_of, whole
from tactile_core.exploration.policies.base import Policy
from tactile_core.parquet import write_table
from tactile_core.progress import counted
from tactile_core.reconstruction.inference import Reconstructor
from tactile_core.reconstruction.trained import TrainedUNet
from tactile_core.settings import RolloutSettings
from tactile_core.spread import Needs, spread
from tactile_core.threads import one_thread


class Part(NamedTuple):
    """Some of the samples, for one of the castings."""

    casting: int
    samples: slice


def cast_on_cluster(
    castings: list[Casting],
    test: Shapes,
    unet: TrainedUNet,
    settings: RolloutSettings,
    reconstructor: Reconstructor,
    progress: Callable[[str], None],
    work: Path | None,
) -> dict[str, pd.DataFrame]:
    """The rollouts of each of `castings` by its key; what `work` keeps of a run that was killed is
    not cast again, and `work` is a folder of this machine."""
    parts = [
        Part(number, samples) for number in range(len(castings)) for samples in portions_of(test)
    ]
    files = [file_of(castings[part.casting], part.samples, work) for part in parts]
    tables = {
        number: table for number, file in enumerate(files) if (table := kept(file)) is not None
    }
    missing = [number for number in range(len(parts)) if number not in tables]
    policies = [(one.policy, one.choice, one.key) for one in castings]
    plain = RolloutSettings(**settings.model_dump())  # other machines may know nothing of Dagster
    needs = Needs(gpu=reconstructor.device.type == "cuda")
    if missing:
        cast = spread(
            cast_samples, [parts[number] for number in missing],
            policies, test, unet, plain, reconstructor.runs,
            needs=needs, progress=progress,
        )  # fmt: skip
        words = "portions of samples cast by a policy"
        for place, table in counted(cast, len(missing), progress, words):
            number = missing[place]
            tables[number] = table
            if (file := files[number]) is not None:
                write_table(table, file)
    return {
        casting.key: whole([tables[at] for at, part in enumerate(parts) if part.casting == number])
        for number, casting in enumerate(castings)
    }


def cast_samples(
    part: Part,
    policies: list[tuple[Policy, str, str]],
    test: Shapes,
    unet: TrainedUNet,
    settings: RolloutSettings,
    runs: str,
    progress: Callable[[str], None],
) -> pd.DataFrame:
    """Some of the rollouts, in a process of the cluster.

    Raises `TactileError` where the U-Net runs through something else there than where the rollouts
    got their keys: the numbers would be others.
    """
    reconstructor = Reconstructor(unet)
    if reconstructor.runs != runs:
        raise TactileError(
            f"the U-Net runs through {reconstructor.runs} on a node of the Ray cluster, and "
            f"through {runs} on this machine: work from a machine that is like its nodes"
        )
    casting = Casting(*policies[part.casting])
    with one_thread():
        return cast_part(casting, part.samples, test, reconstructor, settings, lambda share: None)
