"""A folded U-Net as a walk along its convolutions, in the form that is quickest on processors.

Whoever walks says what a convolution is: an operation of OpenVINO's graph (`engines`), or one of
PyTorch that notes what it was given (`eight_bits`).
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from tactile_core.reconstruction.unet import UNet

# Smaller nets stay in PyTorch: to compile them would take longer than it saves.
FEWEST_WEIGHTS = 30_000


class Convolution(NamedTuple):
    """One of a folded net.

    name : as no other of the net is called
    kernels : (O, I, K, K), or, where it doubles the image, (I, O, 4, 4) of a transposed one
    """

    name: str
    kernels: Tensor
    bias: Tensor
    doubles: bool = False

    @property
    def margin(self) -> int:
        """Pixels of nothing around the image."""
        return 1 if self.doubles else self.kernels.shape[-1] // 2

    @property
    def channel(self) -> int:
        """Which dimension of the kernels counts what comes out."""
        return 1 if self.doubles else 0


class Arithmetic(NamedTuple):
    """What a walk is made of; images are whatever these functions take."""

    convolved: Callable[[Convolution, Any], Any]
    rectified: Callable[[Any], Any]
    halved: Callable[[Any], Any]
    added: Callable[[Any, Any], Any]


def worth_walking(net: UNet) -> bool:
    """Whether a folded net is large, and has no other layers than `walked` knows."""
    blocks = (list(map(type, block.children())) for block in (*net.contract, *net.expand))
    known = all(block == 2 * [nn.Conv2d, nn.Identity, nn.ReLU] for block in blocks)
    return known and sum(weight.numel() for weight in net.parameters()) >= FEWEST_WEIGHTS


def walked(net: UNet, windows: Any, by: Arithmetic) -> Any:
    """Logits of windows: `UNet.complete` of a folded net, by another arithmetic."""
    x, skipped = windows, []
    for level, block in enumerate(net.contract):
        x = by.halved(x) if level else x
        for index in (0, 3):
            x = by.rectified(by.convolved(of(block, index, f"contract.{level}.{index}"), x))
        skipped.append(x)
    skipped.pop()
    for level, (raise_, block) in enumerate(zip(net.raise_, net.expand, strict=True)):
        near, far = both(block, f"expand.{level}.0")
        raised = by.convolved(Convolution(f"raise.{level}", *parameters(raise_)), x)
        x = by.added(by.convolved(near, skipped.pop()), by.convolved(far, raised))
        x = by.convolved(of(block, 3, f"expand.{level}.3"), by.rectified(x))
        x = by.rectified(x)
    return by.convolved(Convolution("head", *parameters(net.head)), x)


def channels_of(net: UNet) -> int:
    """How many channels the windows have."""
    return of(net.contract[0], 0, "").kernels.shape[1]


def of(block: nn.Module, index: int, name: str) -> Convolution:
    """The convolution at a place in a block."""
    assert isinstance(block, nn.Sequential)
    return Convolution(name, *parameters(block[index]))


def both(block: nn.Module, name: str) -> tuple[Convolution, Convolution]:
    """The first convolution of a block that expands, as two whose sum it is: of the channels that
    skip the lower levels, and of those raised from there.

    To double an image and convolve it 3×3 is one transposed convolution 4×4 of the small image,
    with less than half of the products; so neither the double nor both side by side are ever made.
    """
    whole = of(block, 0, name)
    near, far = whole.kernels.chunk(2, dim=1)  # (W, W, 3, 3) each: skipped and raised
    return (
        Convolution(f"{name}.near", near, whole.bias),
        Convolution(f"{name}.far", doubled(far), torch.zeros_like(whole.bias), doubles=True),
    )


def doubled(kernels: Tensor) -> Tensor:
    """Kernels (O, I, 3, 3) for a doubled image as transposed ones (I, O, 4, 4) for the image."""
    flipped = kernels.double().flip(2, 3).flatten(0, 1)[:, None]
    box = torch.ones(1, 1, 2, 2, dtype=torch.double)
    summed = functional.conv2d(flipped, box, padding=1)  # (O·I, 1, 4, 4)
    return summed.unflatten(0, kernels.shape[:2])[:, :, 0].transpose(0, 1).float()


def parameters(layer: nn.Module) -> tuple[Tensor, Tensor]:
    """Kernels and bias of a convolution."""
    assert isinstance(layer, nn.Conv2d)
    assert layer.bias is not None
    return layer.weight.detach(), layer.bias.detach()
