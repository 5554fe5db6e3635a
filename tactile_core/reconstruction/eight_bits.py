"""The U-Net's convolutions in eight bits: half of float32's time, 0.7 of bfloat16's without AMX.

Kernels are rounded to 255 levels, each outgoing channel in its own unit, and what comes in to 256,
over the range that it had for what the U-Net learnt from, but for rare values, which would make all
levels coarser. The first convolution, which sees single pixels beside a faint mean of shapes, stays
as it is: it alone would cost 0.3 points of the Jaccard index.
"""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from tactile_core.dataset.shapes import Shapes
from tactile_core.reconstruction.batches import DrawFelt, training_batches
from tactile_core.reconstruction.folded import Arithmetic, Convolution, walked, worth_walking
from tactile_core.reconstruction.trained import TrainedUNet
from tactile_core.reconstruction.unet import UNet, fuse_normalisation

AS_IT_IS = "contract.0.0"
BATCH = 64
RARE = 100_000  # one value in so many may lie beyond the levels
MOST_PIXELS = 2**20  # of all windows that are measured: 1024 of them at resolution 64


def with_eight_bits(unet: TrainedUNet, train: Shapes, draw: DrawFelt) -> TrainedUNet:
    """The U-Net with the ranges of what its convolutions see, measured on draws of what the `train`
    shapes feel like. Small ones are better off without (see `worth_walking`)."""
    net = fuse_normalisation(unet.net(train))
    if not worth_walking(net):
        return unet
    rng = np.random.default_rng(unet.settings["seed"])
    count = MOST_PIXELS // (unet.resolution // 2) ** 2
    windows = (
        net.windows(
            torch.from_numpy(felt).float()[:, None],
            None if unet.known is None else train.model_ids[indices],
        )
        for indices, felt, _ in training_batches(train, BATCH, rng, draw, count)
    )
    return replace(unet, eight_bits=ranges(net, windows))


@torch.no_grad()
def ranges(net: UNet, batches: Iterable[Tensor]) -> dict[str, Tensor]:
    """Lowest and highest of 256 levels (2,) for what comes into each convolution, by its name.

    batches : windows (N, C, W, W) float32
    """
    seen: dict[str, list[Tensor]] = {}
    signed: set[str] = set()

    def convolved(layer: Convolution, images: Tensor) -> Tensor:
        if layer.name != AS_IT_IS:
            seen.setdefault(layer.name, []).append(highest(images))
            if images.min() < 0:
                signed.add(layer.name)
        if layer.doubles:
            return functional.conv_transpose2d(
                images, layer.kernels, layer.bias, stride=2, padding=layer.margin
            )
        return functional.conv2d(images, layer.kernels, layer.bias, padding=layer.margin)

    def halved(images: Tensor) -> Tensor:
        return functional.max_pool2d(images, 2)

    for windows in batches:
        walked(net, windows, Arithmetic(convolved, torch.relu, halved, torch.add))
    return {name: levels(torch.stack(each).mean(), name in signed) for name, each in seen.items()}


def highest(values: Tensor) -> Tensor:
    """What but one in `RARE` of the values, of either sign, do not exceed."""
    rare = max(1, values.numel() // RARE)
    return values.abs().flatten().topk(rare).values[-1]


def levels(high: Tensor, signed: bool) -> Tensor:
    """Lowest and highest of 256 levels, (2,) float32. Nought is one of them, lest what lies outside
    an image counts."""
    high = high.clamp_min(1e-6)
    return torch.stack([-high * 128 / 127 if signed else torch.zeros_like(high), high])


def highest_kernels(layer: Convolution) -> Tensor:
    """Of the kernels of each outgoing channel the largest weight, of either sign."""
    others = [dimension for dimension in range(4) if dimension != layer.channel]
    return layer.kernels.abs().amax(others, keepdim=True).clamp_min(1e-12)
