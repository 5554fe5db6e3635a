"""One trial of the hyperparameter search, run in a Ray worker process."""

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import torch
from ray import tune
from upath import UPath

from tactile_core.checkpoints import load_checkpoint, save_checkpoint
from tactile_core.dataset.shapes import Shapes
from tactile_core.keys import work_key
from tactile_core.processes import end_with_raylet
from tactile_core.reconstruction.batches import TouchSource, draw_touch_sets
from tactile_core.reconstruction.epoch import PARTS, begin_training, train_epoch
from tactile_core.reconstruction.training import evaluate
from tactile_core.settings import SearchSettings

CHECKPOINT = "trial.pt"


def run_trial(
    config: dict[str, Any],
    train: Shapes,
    eval_shapes: Shapes,
    settings: SearchSettings,
    touches: TouchSource,
    work: Path | UPath,
) -> None:
    """Train one hyperparameter setting, reporting loss and Jaccard on eval after each epoch.

    HyperBand pauses trials and resumes them elsewhere, so each report carries a checkpoint.
    The same checkpoint stays in `work` under a key of all that the trial depends on: epochs
    that an earlier, killed search finished are reported without being trained again.
    """
    end_with_raylet()
    # Ray hands out whole processors; more threads than those only get in each other's way.
    share = tune.get_context().get_trial_resources().required_resources
    torch.set_num_threads(max(1, min(torch.get_num_threads(), int(share["CPU"]))))
    depth, channels = int(config["depth"]), int(config["channels"])
    training = begin_training(depth, channels, float(config["learning_rate"]), settings.seed)
    touch_sets = draw_touch_sets(eval_shapes, np.random.default_rng(settings.seed))
    key = trial_key(config, train, eval_shapes, settings, touches)
    kept = work / f"{key}.pt"
    curve: list[dict[str, float]] = []
    reported = 0
    saved = load_checkpoint(kept, key)
    paused = tune.get_checkpoint()
    if paused:
        with paused.as_directory() as directory:
            past = load_checkpoint(Path(directory) / CHECKPOINT, key) or {"curve": []}
        reported = len(past["curve"])
        if saved is None or reported > len(saved["curve"]):
            saved = past
    if saved and saved["curve"]:
        curve = saved["curve"]
        training.load_state(saved["training"])
    for epoch in range(reported, settings.epochs):
        if epoch >= len(curve):
            batch_size = int(config["batch_size"])
            samples = settings.samples_per_epoch
            train_epoch(training, train, batch_size, touches.draw, samples, parts=PARTS)
            loss, scores = evaluate(training.net, touch_sets, eval_shapes.packed, training.device)
            curve = [*curve, {"loss": loss, "jaccard": float(scores.mean())}]
            save_checkpoint(kept, key, {"curve": curve, "training": training.state()})
        with tempfile.TemporaryDirectory() as directory:
            state = {"curve": curve[: epoch + 1], "training": training.state()}
            save_checkpoint(Path(directory) / CHECKPOINT, key, state)
            tune.report(dict(curve[epoch]), checkpoint=tune.Checkpoint.from_directory(directory))


def trial_key(
    config: dict[str, Any],
    train: Shapes,
    eval_shapes: Shapes,
    settings: SearchSettings,
    touches: TouchSource,
) -> str:
    """The key of everything that a trial's result depends on, however many epochs it may have."""
    tried = {name: repr(value) for name, value in config.items()}
    return work_key(
        "reconstruction.trial",
        settings={**tried, "samples_per_epoch": settings.samples_per_epoch},
        seed=settings.seed,
        train=train.version,
        eval=eval_shapes.version,
        touches=touches.key,
    )
