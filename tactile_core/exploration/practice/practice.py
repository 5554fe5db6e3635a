"""Practice: what the rays of a first, learned policy feel, for the final U-Net to learn from.

A U-Net meets the touches that policies make, and those are neither uniform nor random. So a
first U-Net is trained, then a ray scorer on it, and its rays on the train shapes are recorded.
"""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from upath import UPath

from tactile_core.checkpoints import load_checkpoint, save_checkpoint
from tactile_core.dataset.shapes import Shapes
from tactile_core.exploration.learning.gain_learner import train_scorer
from tactile_core.exploration.policies.base import Policy
from tactile_core.exploration.policies.references import find_reference
from tactile_core.exploration.policies.scorer import ScorerPolicy
from tactile_core.exploration.practice.ray_touches import RaySequences, rays_and_outlines
from tactile_core.exploration.world.rays import RAYS, candidate_rays
from tactile_core.exploration.world.state import Explorations
from tactile_core.files import content_hash
from tactile_core.reconstruction.inference import Reconstructor
from tactile_core.reconstruction.trained import TrainedUNet, load_unet, save_unet
from tactile_core.reconstruction.training import train_unet
from tactile_core.settings import PolicySettings, UNetSettings


class Practice(NamedTuple):
    """Whose rays are recorded: a policy, with this share of its rays replaced by any other."""

    policy: Policy
    strays: float


def practise(
    train: Shapes,
    eval_shapes: Shapes,
    settings: UNetSettings,
    *,
    work: Path,
    progress: Callable[[str], None] = lambda message: None,
) -> RaySequences:
    """Train a first U-Net for half of the epochs, a ray scorer on it, and record their rays.

    `settings` as for `train_unet`; the first U-Net knows no shapes, or what it is to practise on
    would be known to it. `work` receives the checkpoints of both trainings, the first U-Net and the
    sequences themselves: practice that was killed goes on where it was.
    """
    scorer_settings = PolicySettings()
    key = content_hash(
        settings.model_dump(), scorer_settings.model_dump(),
        train.masks.tobytes(), eval_shapes.masks.tobytes(),
    )  # fmt: skip
    finished = work / "sequences.pt"
    saved = load_checkpoint(finished, key)
    if saved:
        return RaySequences(**saved)
    unet = first_unet(train, eval_shapes, settings, key, work / "unet", progress)
    reconstructor = Reconstructor(unet)
    net, _ = train_scorer(
        "practice: gain", settings.seed, train, reconstructor, scorer_settings,
        key=content_hash(key, unet.version()), work=work / "gain", progress=progress,
    )  # fmt: skip
    gain = ScorerPolicy("gain", settings.seed, net.eval())
    coverage = find_reference("coverage")
    practices = [Practice(gain, strays) for strays in (0, 0.1, 0.2, 0.4)]
    practices += [Practice(coverage, strays) for strays in (0.1, 0.2)]
    rng = np.random.default_rng(settings.seed)
    recorded = []
    for number, some in enumerate(practices, start=1):
        recorded.append(record(some, train, reconstructor, rng))
        progress(f"practice: {number}/{len(practices)} runs recorded, {some.policy.name}")
    sequences = RaySequences(*(np.stack(arrays, axis=1) for arrays in zip(*recorded, strict=True)))
    save_checkpoint(finished, key, sequences._asdict())
    shutil.rmtree(work / "unet")
    (work / "gain" / "checkpoint.pt").unlink(missing_ok=True)
    return sequences


def first_unet(
    train: Shapes,
    eval_shapes: Shapes,
    settings: UNetSettings,
    key: str,
    work: Path,
    progress: Callable[[str], None],
) -> TrainedUNet:
    """The U-Net to practise on: trained for half of the epochs, and kept in `work` under `key`."""
    kept = UPath(work / key)
    if (kept / "settings.json").exists():
        return load_unet(kept)
    half = settings.model_copy(
        update={"epochs": max(1, settings.epochs // 2), "known_shapes": False}
    )
    unet = train_unet(
        train, eval_shapes, half, work=work,
        draw=rays_and_outlines(train, settings.seed, settings.free_space),
        progress=lambda message: progress(f"practice: {message}"),
    )  # fmt: skip
    save_unet(unet, kept)
    return unet


def record(
    practice: Practice, train: Shapes, reconstructor: Reconstructor, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Ten rays on every train shape: rays (N, RAYS, 2) int and touches (N, RAYS, 2) int16."""
    candidates = candidate_rays(train.resolution).reshape(-1, 2)
    explorations = Explorations(train.masks, reconstructor)
    rays, touches = [], []
    for _ in range(RAYS):
        chosen = np.array(practice.policy.choose(explorations, rng, deterministic=True))
        stray = np.flatnonzero(rng.random(len(train)) < practice.strays)
        chosen[stray] = candidates[rng.integers(len(candidates), size=len(stray))]
        rays.append(chosen)
        touches.append(explorations.cast(chosen).touches)
    return np.stack(rays, axis=1), np.stack(touches, axis=1)
