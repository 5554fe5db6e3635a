"""The U-Net of the report (section V, Figure 1): touches in, probability of the object out."""

from itertools import pairwise

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional
from torch.nn.utils.fusion import fuse_conv_bn_eval

from tactile_core.errors import TactileError
from tactile_core.reconstruction.known_shapes import KnownShapes

# The logit outside the window: a probability of 2e-9, and still finite in every precision.
OUTSIDE = -20.0


class UNet(nn.Module):
    """U-Net with `depth` levels; the first has `channels`, each further one twice as many.

    Maps what was felt, (N, 1, R, R), 1.0 at a touch, 0.0 where nothing is known and −1.0 where
    a ray has passed (if it was trained on that), to logits (N, 1, R, R).

    Only the middle half of the image passes through the net: the camera scales every model
    to a diagonal of 1 in an image that spans 2, so no shape leaves it, however rotated.
    That quarters the work, and outside it the prediction is "no object".

    With `known` shapes a second channel holds their mean, weighed by what was felt.
    """

    def __init__(self, depth: int, channels: int, known: KnownShapes | None = None) -> None:
        super().__init__()
        self.known = known
        widths = [channels * 2**level for level in range(depth)]
        shallower = list(reversed(widths[:-1]))
        self.contract = nn.ModuleList(
            _block(inside, outside)
            for inside, outside in zip([2 if known else 1, *widths], widths, strict=False)
        )
        # A 1×1 convolution and nearest upsampling commute; this order costs a quarter.
        self.raise_ = nn.ModuleList(nn.Conv2d(2 * width, width, 1) for width in shallower)
        self.expand = nn.ModuleList(_block(2 * width, width) for width in shallower)
        self.head = nn.Conv2d(channels, 1, 1)

    def forward(self, felt: Tensor, models: np.ndarray | None = None) -> Tensor:
        """`models` : (N,) str, of which nothing is recalled, as their own shapes are known."""
        margin = felt.shape[-1] // 4
        logits = self.complete(self.windows(felt, models))
        return functional.pad(logits, [margin] * 4, value=OUTSIDE)

    def windows(self, felt: Tensor, models: np.ndarray | None = None) -> Tensor:
        """The middle half of what was felt and recalled, (N, 1 or 2, W, W)."""
        resolution = felt.shape[-1]
        margin = resolution // 4
        levels = len(self.contract)
        if (resolution - 2 * margin) % 2 ** (levels - 1):
            raise TactileError(
                f"a U-Net of depth {levels} cannot halve a {resolution // 2}-pixel window "
                f"{levels - 1} times: choose a smaller depth or a larger resolution"
            )
        if self.known is not None:
            recalled = self.known.mean(felt[:, 0], models)[:, None].to(felt.dtype)
            felt = torch.cat([felt, recalled], dim=1).contiguous(memory_format=torch.channels_last)
        return felt[..., margin : resolution - margin, margin : resolution - margin]

    def complete(self, x: Tensor) -> Tensor:
        """Logits (N, 1, W, W) of windows (N, 1 or 2, W, W)."""
        skipped = []
        for level, block in enumerate(self.contract):
            x = block(functional.max_pool2d(x, 2) if level else x)  # (N, C·2^level, W/2^level, …)
            skipped.append(x)
        skipped.pop()
        for raise_, block in zip(self.raise_, self.expand, strict=True):
            raised = functional.interpolate(raise_(x), scale_factor=2.0)
            x = block(torch.cat([skipped.pop(), raised], dim=1))
        return self.head(x)


def _block(inside: int, outside: int) -> nn.Sequential:
    """Two 3×3 convolutions, each normalised and rectified."""
    layers: list[nn.Module] = []
    for width in (inside, outside):
        layers += [
            nn.Conv2d(width, outside, 3, padding=1, bias=False),
            nn.BatchNorm2d(outside),
            nn.ReLU(inplace=True),
        ]
    return nn.Sequential(*layers)


def on_device(net: UNet, device: torch.device, dtype: torch.dtype = torch.float32) -> UNet:
    """The net on `device`, channels last: the layout in which convolutions are quickest."""
    return net.to(device, dtype, memory_format=torch.channels_last)  # type: ignore[call-overload]


def fuse_normalisation(net: UNet) -> UNet:
    """Fold every batch normalisation that follows a convolution into it, in eval mode and in place.
    Blocks of other layers stay as they are."""
    net.eval()
    for block in [part for part in net.modules() if isinstance(part, nn.Sequential)]:
        for index, (layer, following) in enumerate(pairwise([*block])):
            if isinstance(layer, nn.Conv2d) and isinstance(following, nn.BatchNorm2d):
                block[index] = fuse_conv_bn_eval(layer, following)
                block[index + 1] = nn.Identity()
    return net
