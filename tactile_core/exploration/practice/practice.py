"""Practice: what the rays of a first, learned policy feel, for the final U-Net to learn from.

A U-Net meets the touches that policies make, and those are neither uniform nor random. So a
first U-Net is trained, then a ray scorer on it, and its rays on the train shapes are recorded.
"""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from upath import UPath

from tactile_core.dataset.shapes import Shapes
from tactile_core.exploration.learning.gain_learner import train_scorer
from tactile_core.exploration.policies.base import Policy
from tactile_core.exploration.policies.references import find_reference
from tactile_core.exploration.policies.scorer import ScorerPolicy
from tactile_core.exploration.practice.ray_touches import rays_and_outlines
from tactile_core.exploration.world.rays import RAYS, candidate_rays
from tactile_core.exploration.world.state import Explorations
from tactile_core.finished import finished_table, keep_finished
from tactile_core.keys import work_key
from tactile_core.progress import teller
from tactile_core.reconstruction.inference import Reconstructor
from tactile_core.reconstruction.trained import TrainedUNet
from tactile_core.reconstruction.training import train_unet
from tactile_core.settings import NetSettings, PracticeSettings, UNetSettings


class Practice(NamedTuple):
    """Whose rays are recorded: a policy, with this share of its rays replaced by any other."""

    policy: Policy
    strays: float


def practise(
    train: Shapes,
    eval_shapes: Shapes,
    settings: PracticeSettings,
    *,
    work: Path | UPath,
    previous: pd.DataFrame | None = None,
    progress: Callable[[str], None] = lambda message: None,
) -> pd.DataFrame:
    """Train a first U-Net, a ray scorer on it, and record their rays on every train sample.

    `settings` must name learning rate, batch size, depth and channels, as for `train_unet`. `work`
    receives the first U-Net and the checkpoints of both trainings: practice that was killed goes
    on where it was.

    Rows: sample_id, sequence (from 0), policy, strays (0–1, the share of its rays that any other
    replaced), rays (RAYS, 2) int16 (alpha, beta) and touches (RAYS, 2) int16 (row, column), which
    are (−1, −1) for a miss; and the key of all this. `previous`, the table of an earlier run, is
    returned where it has the same key.
    """
    key = work_key(
        "exploration.practice.practice", settings=settings, seed=settings.seed,
        train=train.version, eval=eval_shapes.version,
    )  # fmt: skip
    if (made := finished_table(key, previous, work)) is not None:
        progress("practice: kept, as nothing that it depends on has changed")
        return made
    unet = first_unet(train, eval_shapes, settings, work / "unet", progress)
    reconstructor = Reconstructor(unet)
    net, _ = train_scorer(
        "practice: gain", settings.seed, train, reconstructor, settings,
        key=work_key(
            "exploration.learning.gain_learner", settings=settings, seed=settings.seed,
            unet=unet.version(), train=train.version,
        ),
        work=work / "gain", progress=progress,
    )  # fmt: skip
    gain = ScorerPolicy("gain", settings.seed, net.eval())
    coverage = find_reference("coverage")
    practices = [Practice(gain, strays) for strays in (0, 0.1, 0.2, 0.4)]
    practices += [Practice(coverage, strays) for strays in (0.1, 0.2)]
    rng = np.random.default_rng(settings.seed)
    tables = []
    for number, some in enumerate(practices):
        title = f"practice: run {number + 1}/{len(practices)}, {some.policy.name}"
        rays, touches = record(some, train, reconstructor, rng, title, progress)
        table = pd.DataFrame({"sample_id": train.sample_ids, "sequence": number})
        tables.append(
            table.assign(
                policy=some.policy.name,
                strays=float(some.strays),
                rays=pd.Series(list(rays.astype(np.int16)), dtype=object),
                touches=pd.Series(list(touches), dtype=object),
            )
        )
    table = pd.concat(tables, ignore_index=True).assign(key=key)
    keep_finished(table, work)
    return table


def first_unet(
    train: Shapes,
    eval_shapes: Shapes,
    settings: PracticeSettings,
    work: Path | UPath,
    progress: Callable[[str], None],
) -> TrainedUNet:
    """The U-Net to practise on, which `work` keeps until practice is over.

    It knows no shapes: else what it is to practise on would be known to it.
    """
    net_settings = UNetSettings(**settings.model_dump(include=set(NetSettings.model_fields)))
    touches = rays_and_outlines(train, settings.seed, settings.free_space)
    return train_unet(
        train, eval_shapes, net_settings, work=work, touches=touches,
        progress=lambda message: progress(f"practice: {message}"),
    )  # fmt: skip


def record(
    practice: Practice,
    train: Shapes,
    reconstructor: Reconstructor,
    rng: np.random.Generator,
    title: str,
    progress: Callable[[str], None],
) -> tuple[np.ndarray, np.ndarray]:
    """Ten rays on every train shape: rays (N, RAYS, 2) int and touches (N, RAYS, 2) int16."""
    candidates = candidate_rays(train.resolution).reshape(-1, 2)
    rays, touches = [], []
    done, tell = 0, teller(progress, len(train))
    for masks in train.packed.portions():
        explorations = Explorations(masks, reconstructor)
        for _ in range(RAYS):
            chosen = np.array(practice.policy.choose(explorations, rng, deterministic=True))
            stray = np.flatnonzero(rng.random(len(masks)) < practice.strays)
            chosen[stray] = candidates[rng.integers(len(candidates), size=len(stray))]
            rays.append(chosen)
            touches.append(explorations.cast(chosen).touches)
        done += len(masks)
        tell(done, f"{title}: {done} of {len(train)} samples")
    return by_sample(rays), by_sample(touches)


def by_sample(portions: list[np.ndarray]) -> np.ndarray:
    """RAYS arrays (n, 2) of each portion as (N, RAYS, 2)."""
    starts = range(0, len(portions), RAYS)
    return np.concatenate([np.stack(portions[start : start + RAYS], axis=1) for start in starts])
