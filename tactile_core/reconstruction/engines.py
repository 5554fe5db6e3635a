"""The U-Net compiled by OpenVINO: on processors about twice as fast as in PyTorch.

The graph is built here op by op, which takes milliseconds, where tracing takes seconds; a fixed
batch is compiled at its first use and takes a fifth of a second.
"""

import importlib.util
import threading
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
import torch
from torch import Tensor

from tactile_core.reconstruction.eight_bits import highest_kernels
from tactile_core.reconstruction.folded import (
    Arithmetic,
    Convolution,
    channels_of,
    walked,
    worth_walking,
)
from tactile_core.reconstruction.unet import UNet

Precision = Literal["bfloat16", "int8", "float32"]

# Batches are compiled for these sizes, and the last is filled up; larger ones leave the caches.
BATCHES = (1, 8, 32, 128)
MOST_PIXELS = 128 * 64**2
# Threads compile one at a time: two rollouts that began together once ended in a corrupted heap,
# which could not be provoked again, and OpenVINO has had races there.
COMPILING = threading.Lock()
# What is not in eight bits then.
HINTS: dict[Precision, str] = {"bfloat16": "bf16", "int8": "f32", "float32": "f32"}


def openvino_pays(net: UNet, device: torch.device) -> bool:
    """Whether a folded net is quicker through OpenVINO: on a processor, where it is installed."""
    installed = importlib.util.find_spec("openvino") is not None
    return device.type == "cpu" and installed and worth_walking(net)


class CompiledUNet:
    """A folded U-Net for one process and one thread at a time; it does not pickle.

    One thread of its own, which is not bound to a core: many of these run side by side.
    """

    def __init__(
        self, net: UNet, precision: Precision, resolution: int, eight_bits: Mapping[str, Tensor]
    ) -> None:
        self.net = net
        self.precision = precision
        self.eight_bits = eight_bits if precision == "int8" else {}
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
            result = infer(self.request(batch), np.ascontiguousarray(part))
            found[start : start + batch] = result[: len(windows) - start, 0]
            start += batch
        return found

    def batch_for(self, left: int) -> int:
        """The size to take next: the largest that can be filled, or the one above it where that is
        filled by more than half."""
        return next(batch for batch in reversed(self.batches) if 2 * left > batch)

    def request(self, batch: int) -> Any:
        """What runs a batch of a size, compiled when it is first asked for."""
        if batch not in self.requests:
            with COMPILING:
                self.requests[batch] = self.compiled(batch)
        return self.requests[batch]

    def compiled(self, batch: int) -> Any:
        """The same, compiled now."""
        import openvino

        options = {
            "INFERENCE_PRECISION_HINT": HINTS[self.precision],
            "INFERENCE_NUM_THREADS": 1,
            "NUM_STREAMS": 1,
            "ENABLE_CPU_PINNING": False,
        }
        model = graph(self.net, batch, self.side, self.eight_bits)
        return openvino.Core().compile_model(model, "CPU", options).create_infer_request()


def infer(request: Any, given: np.ndarray) -> np.ndarray:
    """Probabilities (batch, 1, W, W) float32 of windows (batch, C, W, W) float32, valid until the
    request's next use. Neither is copied: OpenVINO's own way with arrays spends a third of a single
    image's time on that."""
    import openvino

    request.set_input_tensor(openvino.Tensor(given, shared_memory=True))
    request.infer(share_outputs=True)
    return request.get_output_tensor().data


def graph(net: UNet, batch: int, side: int, eight_bits: Mapping[str, Tensor]) -> Any:
    """A folded net as OpenVINO's graph: windows (batch, C, side, side) to probabilities.

    Convolutions that `eight_bits` knows run in eight bits.
    """
    import openvino
    from openvino import opset11 as ops

    given = ops.parameter([batch, channels_of(net), side, side], np.float32)

    def convolved(layer: Convolution, x: Any) -> Any:
        kernels = ops.constant(array(layer.kernels))
        if layer.name in eight_bits:
            low, high = eight_bits[layer.name]
            x = at_levels(x, low, high, 256)
            most = highest_kernels(layer)
            kernels = at_levels(kernels, -most, most, 255)
        margin = [layer.margin] * 2
        if layer.doubles:
            product = ops.convolution_backprop_data(
                x, kernels, [2, 2], pads_begin=margin, pads_end=margin, dilations=[1, 1]
            )
        else:
            product = ops.convolution(x, kernels, [1, 1], margin, margin, [1, 1])
        return ops.add(product, array(layer.bias).reshape(1, -1, 1, 1))

    by = Arithmetic(
        convolved,
        rectified=ops.relu,
        halved=lambda x: ops.max_pool(x, [2, 2], [1, 1], [0, 0], [0, 0], [2, 2]).output(0),
        added=ops.add,
    )
    return openvino.Model([ops.sigmoid(walked(net, given, by))], [given])


def at_levels(x: Any, low: Tensor, high: Tensor, levels: int) -> Any:
    """`x` at the nearest of so many levels, which OpenVINO takes for a product of integers."""
    from openvino import opset11 as ops

    ends = ops.constant(array(low)), ops.constant(array(high))
    return ops.fake_quantize(x, *ends, *ends, levels=levels).output(0)


def array(tensor: Tensor) -> np.ndarray:
    return np.ascontiguousarray(tensor.float().numpy())
