"""What can be attained: the ideal observers on some of the test shapes, beside all policies."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd

from tactile_core.dataset.shapes import Shapes
from tactile_core.errors import TactileError
from tactile_core.evaluation.readings import per_step_reading
from tactile_core.evaluation.rollouts import cast_rollouts
from tactile_core.exploration.policies.observer import IdealObserver
from tactile_core.exploration.policies.references import REFERENCES
from tactile_core.exploration.policies.scorer import RayScorer
from tactile_core.exploration.world.rays import RAYS
from tactile_core.finished import forget_stored
from tactile_core.reconstruction.known_shapes import KnownShapes
from tactile_core.reconstruction.trained import TrainedUNet
from tactile_core.settings import EvaluationSettings, ObserverSettings, RolloutSettings

SAMPLES_AT_A_TIME = 6  # some minutes of work, which a killed run has to do again


def cast_observers(
    test: Shapes,
    seed: int,
    unet: TrainedUNet,
    belief: np.ndarray,
    scorer: RayScorer | None,
    settings: ObserverSettings,
    previous: pd.DataFrame | None = None,
    progress: Callable[[str], None] = lambda message: None,
    work: Path | None = None,
) -> pd.DataFrame:
    """Ten rays of each ideal observer on one sample of each of `settings.samples` test models.

    seed, unet : the U-Net and its seed, which the column seed names
    belief : (n, R, R) bool, shapes of the distribution that the test shapes are of
    scorer : proposes rays to the observer that looks ahead, which is left out without it
    work : keeps what is cast until it is among `previous`, as in `cast_with_each`
    previous, and the columns of what is returned : as in `cast_rollouts`
    """
    known = KnownShapes(belief)
    observers = [IdealObserver(known), *([IdealObserver(known, scorer)] if scorer else [])]
    rays = RolloutSettings(references=[], count=RAYS, ray_limit=RAYS, seed=settings.seed)
    some = one_of_each(test, settings.samples)
    tables = []
    for start in range(0, len(some), SAMPLES_AT_A_TIME):
        portion = some.select(np.arange(len(some))[start : start + SAMPLES_AT_A_TIME])

        def tell(message: str, before: int = start) -> None:
            progress(f"{before} of {len(some)} samples are done; {message}")

        tables.append(cast_rollouts(observers, portion, unet, rays, previous, tell, work=work))
    table = pd.concat(tables, ignore_index=True).assign(seed=seed)
    forget_stored(table, previous, work)
    return table


def one_of_each(test: Shapes, count: int) -> Shapes:
    """One sample of each of `count` models, or of all if there are no more, spread evenly."""
    _, first = np.unique(test.model_ids, return_index=True)
    chosen = np.linspace(0, len(first) - 1, min(count, len(first))).round().astype(int)
    return test.select(np.sort(first[chosen]))


def attainable_reading(
    observed: pd.DataFrame, rollouts: pd.DataFrame, settings: EvaluationSettings
) -> pd.DataFrame:
    """Observers and policies on the same samples, as `per_step_reading` has them.

    Where there are several U-Nets, those policies that go with the observers' own.

    Raises `TactileError` where the rollouts are on other samples.
    """
    samples = observed["sample_id"].unique()
    if missing := set(samples) - set(rollouts["sample_id"]):
        raise TactileError(
            f"attainable_rollouts are on samples that rollouts lack (first: {min(missing)}): "
            "materialise attainable_rollouts again"
        )
    if rollouts.loc[rollouts["policy"].isin(REFERENCES), "seed"].nunique() > 1:
        rollouts = rollouts[rollouts["seed"].isin(observed["seed"])]
    same = rollouts["sample_id"].isin(samples) & (rollouts["ray"] <= RAYS)
    return per_step_reading(pd.concat([rollouts[same], observed], ignore_index=True), settings)
