"""One epoch of the U-Net's training: a step of AdamW for each batch of masks and touches.

A U-Net of a few channels gains nothing from two threads that share each layer's work. So they share
the batch: each part of it passes through the net on a thread of its own and is normalised by
itself. How a batch is parted does not depend on how many processors there are.
"""

import copy
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from tactile_core.dataset.shapes import Shapes
from tactile_core.errors import TactileError
from tactile_core.reconstruction.batches import DrawFelt, felt_outlines, training_batches
from tactile_core.reconstruction.inference import best_device, bfloat16_pays
from tactile_core.reconstruction.known_shapes import KnownShapes
from tactile_core.reconstruction.unet import UNet, on_device

PARTS = 2
SMALLEST_PART = 8  # images: the mean and deviation of fewer are too rough to normalise by


@dataclass
class UNetTraining:
    """A U-Net in training: the net, its optimiser and all that a checkpoint must hold."""

    net: UNet
    optimizer: torch.optim.Optimizer
    rng: np.random.Generator
    device: torch.device

    def state(self) -> dict[str, Any]:
        return {
            "net": self.net.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "rng": self.rng.bit_generator.state,
        }

    def load_state(self, state: dict[str, Any]) -> None:
        self.net.load_state_dict(state["net"])
        self.optimizer.load_state_dict(state["optimizer"])
        self.rng.bit_generator.state = state["rng"]


def begin_training(
    depth: int, channels: int, learning_rate: float, seed: int, known: KnownShapes | None = None
) -> UNetTraining:
    """A freshly initialised U-Net with its optimiser, on the best device."""
    torch.manual_seed(seed)
    device = best_device()
    net = on_device(UNet(depth, channels, known), device)
    if known and bfloat16_pays(device.type):
        known.to(torch.bfloat16)
    optimizer = torch.optim.AdamW(net.parameters(), lr=learning_rate, weight_decay=1e-4, fused=True)
    return UNetTraining(net, optimizer, np.random.default_rng(seed), device)


def train_epoch(
    training: UNetTraining,
    shapes: Shapes,
    batch_size: int,
    draw: DrawFelt | None = None,
    samples: int | None = None,
    before_batch: Callable[[float], None] = lambda share: None,
    parts: int = 1,
) -> float:
    """One epoch of binary cross-entropy; returns the mean loss over all pixels of all batches.

    `before_batch` is told what share of the epoch is done. On a processor each batch is trained
    with in `parts` at once, or in fewer where that would leave a part fewer images than
    `SMALLEST_PART`, and whole where the net has dropout. Raises `TactileError` where the loss is
    no longer finite.
    """
    training.net.train()
    if training.device.type != "cpu" or draws_numbers(training.net):
        parts = 1
    nets = sharing_weights(training.net, parts)
    count = min(samples or len(shapes), len(shapes))
    batches = training_batches(
        shapes, batch_size, training.rng, draw or felt_outlines(shapes), samples
    )
    total, seen = 0.0, 0
    with ThreadPoolExecutor(len(nets)) as threads:
        for indices, felt, masks in batches:
            before_batch(seen / count)
            models = shapes.model_ids[indices] if training.net.known else None
            loss = backward(nets, felt, masks, training.device, models, threads)
            nn.utils.clip_grad_norm_(training.net.parameters(), 1.0)
            training.optimizer.step()
            total += loss.item() * len(masks)
            seen += len(masks)
    keep_mean_statistics(nets)
    return finite(total / seen)


def draws_numbers(net: nn.Module) -> bool:
    """Whether it has dropout, whose numbers two threads would draw by who comes first."""
    return any(isinstance(layer, nn.modules.dropout._DropoutNd) for layer in net.modules())


def sharing_weights(net: UNet, count: int) -> list[UNet]:
    """The net and others that have its weights, and running statistics of their own."""
    shared = {id(part): part for part in (*net.parameters(), net.known)}
    return [net, *(copy.deepcopy(net, dict(shared)) for _ in range(count - 1))]


@torch.no_grad()
def keep_mean_statistics(nets: Sequence[UNet]) -> None:
    """Give the first net the mean of all running means and variances."""
    for own, *others in zip(*(net.buffers() for net in nets), strict=True):
        if own.is_floating_point() and not any(other is own for other in others):
            own.copy_(torch.stack([own, *others]).mean(dim=0))


def backward(
    nets: Sequence[UNet],
    felt: np.ndarray,
    masks: np.ndarray,
    device: torch.device,
    models: np.ndarray | None,
    threads: ThreadPoolExecutor,
) -> Tensor:
    """The loss as of `loss_and_logits`; its gradients become those of the weights that all share.

    Each net has a part of the batch, by which its layers normalise.
    """
    weights = [weight for weight in nets[0].parameters() if weight.requires_grad]
    count = min(len(nets), max(1, len(masks) // SMALLEST_PART))
    parts = np.array_split(np.arange(len(masks)), count)

    def of_part(net: UNet, part: np.ndarray) -> tuple[Tensor, Sequence[Tensor | None]]:
        own = None if models is None else models[part]
        loss, _ = loss_and_logits(net, felt[part], masks[part], device, own)
        loss = loss * (len(part) / len(masks))
        # Not loss.backward(): in two threads that adds up by who comes first.
        return loss.detach(), torch.autograd.grad(loss, weights, allow_unused=True)

    found = list((threads.map if count > 1 else map)(of_part, nets[:count], parts))
    for weight, *gradients in zip(weights, *(each for _, each in found), strict=True):
        used = [gradient for gradient in gradients if gradient is not None]
        # In the layout of the weight: fused AdamW takes it for granted, and looks at no other.
        weight.grad = torch.zeros_like(weight) if used else None
        for gradient in used:
            weight.grad += gradient
    return torch.stack([loss for loss, _ in found]).sum()


def loss_and_logits(
    net: nn.Module,
    felt: np.ndarray,
    masks: np.ndarray,
    device: torch.device,
    models: np.ndarray | None = None,
) -> tuple[Tensor, Tensor]:
    """Mean binary cross-entropy over all pixels of (B, R, R) felt images and masks, and the
    logits (B, 1, R, R) float32, on `device`.

    models : (B,) str, whose masks these are, for a net that must not recall them
    """
    inputs = torch.from_numpy(felt).to(device, torch.float32)[:, None]
    labels = torch.from_numpy(masks).to(device, torch.float32)[:, None]
    pays = bfloat16_pays(device.type)
    # Each weight is used once: to keep what it was cast to would only tie threads together.
    with torch.autocast(device.type, torch.bfloat16, enabled=pays, cache_enabled=False):
        logits = net(inputs.contiguous(memory_format=torch.channels_last), models).float()
    return functional.binary_cross_entropy_with_logits(logits, labels), logits


def finite(loss: float) -> float:
    """The loss; raises `TactileError` where the training has exploded."""
    if not np.isfinite(loss):
        raise TactileError("the U-Net's loss is no longer finite: choose a lower learning_rate")
    return loss
