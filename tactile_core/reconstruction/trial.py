"""One trial of the hyperparameter search, run in a Ray worker process."""

import tempfile
from pathlib import Path
from typing import Any

import torch
from ray import tune

from tactile_core.dataset.shapes import Shapes
from tactile_core.files import content_hash, written_whole
from tactile_core.reconstruction.training import (
    begin_training,
    evaluate,
    fixed_touch_sets,
    train_epoch,
)
from tactile_core.settings import SearchSettings

CHECKPOINT = "trial.pt"


def run_trial(
    config: dict[str, Any],
    train: Shapes,
    evaluation: Shapes,
    settings: SearchSettings,
    work: Path,
) -> None:
    """Train one hyperparameter setting, reporting loss and Jaccard on eval after each epoch.

    HyperBand pauses trials and resumes them elsewhere, so each report carries a checkpoint.
    The same checkpoint stays in `work` under a key of all that the trial depends on: epochs
    that an earlier, killed search finished are reported without being trained again.
    """
    # Ray hands out whole processors; more threads than those only get in each other's way.
    share = tune.get_context().get_trial_resources().required_resources
    torch.set_num_threads(max(1, int(share["CPU"])))
    depth, channels = int(config["depth"]), int(config["channels"])
    training = begin_training(depth, channels, float(config["learning_rate"]), settings.seed)
    touch_sets = fixed_touch_sets(evaluation, settings.seed)
    kept = work / f"{trial_key(config, train, settings)}.pt"
    curve, state = saved_epochs(kept)
    done = 0
    paused = tune.get_checkpoint()
    if paused:
        with paused.as_directory() as directory:
            past, past_state = saved_epochs(Path(directory) / CHECKPOINT)
        done = len(past)
        if len(past) > len(curve):
            curve, state = past, past_state
    if state:
        training.load_state(state)
    for epoch in range(done, settings.epochs):
        if epoch >= len(curve):
            batch_size = int(config["batch_size"])
            train_epoch(training, train, batch_size, samples=settings.samples_per_epoch)
            loss, scores = evaluate(training.net, touch_sets, evaluation.masks, training.device)
            curve = [*curve, {"loss": loss, "jaccard": float(scores.mean())}]
            state = training.state()
            save_epochs(kept, curve, state)
        with tempfile.TemporaryDirectory() as directory:
            save_epochs(Path(directory) / CHECKPOINT, curve[: epoch + 1], state)
            tune.report(dict(curve[epoch]), checkpoint=tune.Checkpoint.from_directory(directory))


def trial_key(config: dict[str, Any], train: Shapes, settings: SearchSettings) -> str:
    """Hash of everything that a trial's result depends on."""
    tried = {name: repr(value) for name, value in sorted(config.items())}
    budget = settings.seed, settings.samples_per_epoch
    return content_hash(tried, budget, train.masks.tobytes())


def save_epochs(path: Path, curve: list[dict[str, float]], state: dict[str, Any]) -> None:
    with written_whole(path) as file:
        torch.save({"curve": curve, "state": state}, file)


def saved_epochs(path: Path) -> tuple[list[dict[str, float]], dict[str, Any]]:
    """Curve and training state of a checkpoint; empty where there is none to read."""
    try:
        saved = torch.load(path, map_location="cpu", weights_only=False)
    except (OSError, RuntimeError, EOFError):
        return [], {}
    return saved["curve"], saved["state"]
