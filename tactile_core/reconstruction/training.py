"""Training the reconstruction U-Net (report, section V)."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch
from torch import nn
from upath import UPath

from tactile_core.checkpoints import load_checkpoint, save_checkpoint
from tactile_core.dataset.packed import PackedMasks
from tactile_core.dataset.shapes import Shapes
from tactile_core.dataset.touches import rasterise_touches
from tactile_core.files import remove_folder
from tactile_core.keys import work_key
from tactile_core.progress import teller
from tactile_core.reconstruction.batches import TouchSource, draw_touch_sets, outline_source
from tactile_core.reconstruction.eight_bits import with_eight_bits
from tactile_core.reconstruction.epoch import (
    PARTS,
    UNetTraining,
    begin_training,
    finite,
    loss_and_logits,
    train_epoch,
)
from tactile_core.reconstruction.hyperparameters import required
from tactile_core.reconstruction.jaccard import jaccard_index
from tactile_core.reconstruction.known_shapes import KnownShapes, pack, picked, unpack
from tactile_core.reconstruction.trained import TrainedUNet, save_unet, unet_at
from tactile_core.settings import UNetSettings
from tactile_core.tensorboard import curves_folder

EVALUATION_BATCH = 128


def evaluate(
    net: nn.Module,
    touch_sets: Sequence[np.ndarray],
    masks: PackedMasks,
    device: torch.device,
    models: np.ndarray | None = None,
    owners: np.ndarray | None = None,
) -> tuple[float, np.ndarray]:
    """Loss (mean over pixels) and Jaccard indices (N,) of N touch sets (k, 2) on their masks.

    models : (M,) str, whose masks these are, for a net that must not recall them
    owners : (N,) int, the mask of each touch set; None: they are N, and in the same order

    Raises `TactileError` where the loss is not finite.
    """
    net.eval()
    owners = np.arange(len(masks)) if owners is None else owners

    @torch.no_grad()
    def of_batch(start: int) -> tuple[float, np.ndarray]:
        batch = slice(start, start + EVALUATION_BATCH)
        some, own = masks[owners[batch]], None if models is None else models[owners[batch]]
        touched = rasterise_touches(touch_sets[batch], masks.shape[-1])
        loss, logits = loss_and_logits(net, touched, some, device, own)
        scores = jaccard_index(torch.sigmoid(logits)[:, 0].cpu().numpy(), some)
        return loss.item() * len(some), scores

    with ThreadPoolExecutor(PARTS if device.type == "cpu" else 1) as threads:
        found = list(threads.map(of_batch, range(0, len(owners), EVALUATION_BATCH)))
    losses, scores = zip(*found, strict=True)
    return finite(sum(losses) / len(owners)), np.concatenate(scores)


def train_unet(
    train: Shapes,
    eval_shapes: Shapes,
    settings: UNetSettings,
    *,
    work: Path | UPath,
    touches: TouchSource | None = None,
    previous: TrainedUNet | None = None,
    progress: Callable[[str], None] = lambda message: None,
) -> TrainedUNet:
    """Train to the end and return the weights of the epoch with the lowest eval loss, or return
    `previous` where it was trained with the same code, settings, seed and inputs.

    `settings` must name learning rate, batch size, depth and channels (see
    `hyperparameters.with_best_trial`). The rate warms up over the first epoch and then falls along
    a cosine. `work` receives TensorBoard curves and a checkpoint after each epoch: a
    training killed and started again with equal inputs goes on where it was, to the same
    result. When it ends, `work` keeps the U-Net in the checkpoint's place until it comes back as
    `previous`: whoever asked for it has stored it then. `touches` replaces the uniform draw of
    outline touches; it must draw free space too where `settings.free_space` is set.
    """
    rate, batch_size, depth, channels = required(settings)
    touches = touches or outline_source(train)
    key = work_key(
        "reconstruction.training",
        settings=settings,
        seed=settings.seed,
        train=train.version,
        eval=eval_shapes.version,
        touches=touches.key,
    )
    finished = UPath(work) / "trained"
    if previous is not None and previous.key == key:
        remove_folder(finished)
    else:
        previous = unet_at(finished)
    if previous is not None and previous.key == key:
        progress("U-Net: kept, as nothing that it depends on has changed")
        return previous
    packed = pack(train.packed) if settings.known_shapes else None
    known = None
    if packed is not None:
        models = train.model_ids[picked(len(train))]
        known = KnownShapes(unpack(packed, train.resolution), models)
    training = begin_training(depth, channels, rate, settings.seed, known)
    touch_sets = draw_touch_sets(eval_shapes, np.random.default_rng(settings.seed))
    checkpoint = work / "checkpoint.pt"
    curve: list[dict[str, float]] = []
    best: dict[str, Any] = {}
    saved = load_checkpoint(checkpoint, key)
    if saved:
        training.load_state(saved["training"])
        curve, best = saved["curve"], saved["best"]
        progress(f"U-Net: resuming after epoch {len(curve)}")
    curves = curves_folder(work, resumed=bool(saved))
    tell = teller(progress, settings.epochs)
    for epoch in range(len(curve) + 1, settings.epochs + 1):
        if stopped_early(curve, settings.patience):
            progress(f"U-Net: no better eval loss for {settings.patience} epochs, stopping")
            break

        def before_batch(share: float, done: int = epoch - 1) -> None:
            set_rate(training, rate, done + share, settings.epochs)
            tell(done + share, f"U-Net: {share:.0%} through epoch {done + 1} of {settings.epochs}")

        loss = train_epoch(
            training, train, batch_size, touches.draw, before_batch=before_batch, parts=PARTS
        )
        eval_loss, scores = evaluate(training.net, touch_sets, eval_shapes.packed, training.device)
        row = {
            "epoch": epoch, "train_loss": loss,
            "eval_loss": eval_loss, "eval_jaccard": float(scores.mean()),
        }  # fmt: skip
        if eval_loss < min((past["eval_loss"] for past in curve), default=np.inf):
            best = {name: value.cpu().clone() for name, value in training.net.state_dict().items()}
        curve.append(row)
        log_curve(curves, row)
        state = {"training": training.state(), "curve": curve, "best": best}
        save_checkpoint(checkpoint, key, state)
        progress(
            f"U-Net: epoch {epoch}/{settings.epochs}, loss {loss:.4f}, "
            f"eval loss {eval_loss:.4f}, eval Jaccard {row['eval_jaccard']:.1f}"
        )
    kept = min(curve, key=lambda row: row["eval_loss"])
    unet = TrainedUNet(
        weights={name: value.contiguous() for name, value in best.items()},
        known=packed,
        resolution=train.resolution,
        depth=depth,
        channels=channels,
        settings=settings.model_dump(),
        scores={name: kept[name] for name in ("epoch", "eval_loss", "eval_jaccard")},
        curve=pd.DataFrame(curve),
        trained_on=pd.concat(
            [train.models().assign(split="train"), eval_shapes.models().assign(split="eval")],
            ignore_index=True,
        ),
        key=key,
    )
    unet = with_eight_bits(unet, train, touches.draw)
    save_unet(unet, finished)
    checkpoint.unlink(missing_ok=True)
    return unet


def set_rate(training: UNetTraining, rate: float, epochs_done: float, epochs: int) -> None:
    """Linear warm-up over the first epoch, then a cosine down to a hundredth."""
    cosine = 0.505 + 0.495 * np.cos(np.pi * epochs_done / epochs)
    for group in training.optimizer.param_groups:
        group["lr"] = rate * min(0.05 + epochs_done, 1.0) * cosine


def stopped_early(curve: list[dict[str, float]], patience: int) -> bool:
    """Whether the lowest eval loss is `patience` epochs old."""
    losses = [row["eval_loss"] for row in curve]
    return bool(losses) and len(losses) - 1 - int(np.argmin(losses)) >= patience


def log_curve(folder: Path, row: dict[str, float]) -> None:
    """One epoch's losses and Jaccard index to TensorBoard in `folder`."""
    from torch.utils.tensorboard import SummaryWriter

    with SummaryWriter(str(folder)) as writer:
        for name in ("train_loss", "eval_loss", "eval_jaccard"):
            writer.add_scalar(name, row[name], row["epoch"])
