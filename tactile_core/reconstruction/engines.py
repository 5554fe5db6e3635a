"""The U-Net compiled by OpenVINO: on processors about twice as fast as in PyTorch.

The graph is built here op by op, which takes milliseconds, where tracing takes seconds; a fixed
batch is compiled at its first use and takes a fifth of a second.
"""

import importlib.util
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from tactile_core.reconstruction.unet import UNet

# Smaller nets stay in PyTorch: compiling them would take longer than it saves.
FEWEST_WEIGHTS = 30_000
# Batches are compiled for these sizes, and the last is filled up; larger ones leave the caches.
BATCHES = (8, 32, 128)
MOST_PIXELS = 128 * 64**2
PRECISIONS = {torch.bfloat16: "bf16", torch.float32: "f32"}


def openvino_pays(net: UNet, device: torch.device) -> bool:
    """Whether a folded net is quicker through OpenVINO: large ones on a processor, where it is.

    Not one whose blocks have other layers, which `graph` would not know.
    """
    weights = sum(weight.numel() for weight in net.parameters())
    installed = importlib.util.find_spec("openvino") is not None
    blocks = (list(map(type, block.children())) for block in (*net.contract, *net.expand))
    known = all(block == 2 * [nn.Conv2d, nn.Identity, nn.ReLU] for block in blocks)
    return device.type == "cpu" and installed and known and weights >= FEWEST_WEIGHTS


class CompiledUNet:
    """A folded U-Net for one process and one thread at a time; it does not pickle.

    One thread of its own, which is not bound to a core: many of these run side by side.
    """

    def __init__(self, net: UNet, dtype: torch.dtype, resolution: int) -> None:
        self.net = net
        self.precision = PRECISIONS[dtype]
        self.side = resolution // 2  # of the window that passes through the net
        most = max(BATCHES[0], MOST_PIXELS // resolution**2)
        self.batches = [batch for batch in BATCHES if batch <= most]
        self.requests: dict[int, Any] = {}

    def complete(self, windows: np.ndarray) -> np.ndarray:
        """Probabilities (N, W, W) float32 of windows (N, C, W, W) float32."""
        found = np.empty((len(windows), self.side, self.side), np.float32)
        start = 0
        while start < len(windows):
            batch = self.batch_for(len(windows) - start)
            part = windows[start : start + batch]
            if len(part) < batch:
                part = np.concatenate([part, np.zeros((batch - len(part), *part.shape[1:]), "f4")])
            result = self.request(batch).infer([np.ascontiguousarray(part)])[0]
            found[start : start + batch] = result[: len(windows) - start, 0]
            start += batch
        return found

    def batch_for(self, left: int) -> int:
        """The size to take next: the largest that can be filled, or the one above it where that is
        filled by more than half."""
        for batch in reversed(self.batches):
            if 2 * left > batch:
                return batch
        return self.batches[0]

    def request(self, batch: int) -> Any:
        """What runs a batch of a size, compiled when it is first asked for."""
        if batch not in self.requests:
            import openvino

            options = {
                "INFERENCE_PRECISION_HINT": self.precision,
                "INFERENCE_NUM_THREADS": 1,
                "NUM_STREAMS": 1,
                "ENABLE_CPU_PINNING": False,
            }
            model = graph(self.net, batch, self.side)
            compiled = openvino.Core().compile_model(model, "CPU", options)
            self.requests[batch] = compiled.create_infer_request()
        return self.requests[batch]


def graph(net: UNet, batch: int, side: int) -> Any:
    """A folded net as OpenVINO's graph: windows (batch, C, side, side) to probabilities."""
    import openvino
    from openvino import opset11 as ops

    first = net.contract[0]
    assert isinstance(first, nn.Sequential)
    assert isinstance(first[0], nn.Conv2d)
    given = ops.parameter([batch, first[0].in_channels, side, side], np.float32)
    x, skipped = given, []
    for level, block in enumerate(net.contract):
        if level:
            x = ops.max_pool(x, [2, 2], [1, 1], [0, 0], [0, 0], [2, 2]).output(0)
        x = convolved_twice(x, block)
        skipped.append(x)
    skipped.pop()
    for raise_, block in zip(net.raise_, net.expand, strict=True):
        x = expanded(skipped.pop(), convolved(x, raise_), block)
    return openvino.Model([ops.sigmoid(convolved(x, net.head))], [given])


def expanded(skipped: Any, raised: Any, block: nn.Module) -> Any:
    """What `block` makes of the channels that skip the lower levels and of those raised from there.

    To double an image and convolve it 3×3 is one transposed convolution 4×4 of the small image,
    with less than half of the products; so neither the double nor both side by side are ever made.
    """
    from openvino import opset11 as ops

    assert isinstance(block, nn.Sequential)
    first = block[0]
    assert isinstance(first, nn.Conv2d)
    assert first.bias is not None
    near, far = first.weight.detach().chunk(2, dim=1)  # (W, W, 3, 3) each: skipped and raised
    margin = [1, 1]
    both = ops.add(
        ops.convolution(skipped, array(near), [1, 1], margin, margin, [1, 1]),
        ops.convolution_backprop_data(
            raised, array(doubled(far)), [2, 2], pads_begin=margin, pads_end=margin,
            dilations=[1, 1],
        ),
    )  # fmt: skip
    x = ops.relu(ops.add(both, per_channel(first.bias)))
    return ops.relu(convolved(x, block[3]))


def doubled(kernels: Tensor) -> Tensor:
    """Kernels (O, I, 3, 3) for a doubled image as transposed ones (I, O, 4, 4) for the image."""
    flipped = kernels.double().flip(2, 3).flatten(0, 1)[:, None]
    box = torch.ones(1, 1, 2, 2, dtype=torch.double)
    summed = nn.functional.conv2d(flipped, box, padding=1)  # (O·I, 1, 4, 4)
    return summed.unflatten(0, kernels.shape[:2])[:, :, 0].transpose(0, 1)


def convolved_twice(x: Any, block: nn.Module) -> Any:
    """`x` through one block of a folded net."""
    from openvino import opset11 as ops

    assert isinstance(block, nn.Sequential)
    return ops.relu(convolved(ops.relu(convolved(x, block[0])), block[3]))


def convolved(x: Any, layer: nn.Module) -> Any:
    """`x` through one convolution, with its bias."""
    from openvino import opset11 as ops

    assert isinstance(layer, nn.Conv2d)
    margin = [int(layer.kernel_size[0] // 2)] * 2
    product = ops.convolution(x, array(layer.weight), [1, 1], margin, margin, [1, 1])
    assert layer.bias is not None
    return ops.add(product, per_channel(layer.bias))


def per_channel(bias: Tensor) -> np.ndarray:
    return array(bias).reshape(1, -1, 1, 1)


def array(weight: Tensor) -> np.ndarray:
    return np.ascontiguousarray(weight.detach().float().numpy())
