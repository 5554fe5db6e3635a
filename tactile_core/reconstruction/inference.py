"""Fast reconstruction: many touch images in one pass of the U-Net, in the quickest precision."""

import functools
import os
from typing import Literal

import numpy as np
import torch

from tactile_core.errors import TactileError
from tactile_core.reconstruction.engines import CompiledUNet, Precision, openvino_pays
from tactile_core.reconstruction.trained import TrainedUNet
from tactile_core.reconstruction.unet import OUTSIDE, fuse_normalisation, on_device

# A process forked off one in which PyTorch has several threads, as Gymnasium's asynchronous
# environments are, has but one of them, and would wait for the others for ever.
os.register_at_fork(after_in_child=lambda: torch.set_num_threads(1))

# Larger batches leave the CPU's caches, and do not fit a GPU's memory.
LARGEST_CPU_BATCH = {torch.bfloat16: 256, torch.float32: 64}
MOST_GPU_PIXELS = 2**23  # 128 images at 256×256: some 3 GB in the report's widest net
NO_OBJECT = torch.sigmoid(torch.tensor(OUTSIDE)).item()  # what the U-Net says outside its window
LARGEST_TABLE = 64  # resolution; 17 MB there, and sixteen times as much at twice that


def best_device() -> torch.device:
    """CUDA where there is one, else the CPU."""
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")


@functools.cache
def bfloat16_pays(device_type: str) -> bool:
    """Whether the processor multiplies bfloat16 matrices natively; others only emulate it."""
    if device_type == "cuda":
        return torch.cuda.is_bf16_supported(including_emulation=False)
    return torch.cpu._is_avx512_bf16_supported() or torch.cpu._is_amx_tile_supported()


@functools.cache
def has_amx() -> bool:
    """Whether the processor multiplies tiles: without, eight bits take 0.7 of bfloat16's time."""
    return torch.cpu._is_amx_tile_supported()


class Reconstructor:
    """A trained U-Net ready to predict.

    On a processor it runs through OpenVINO, where that pays, else through PyTorch; shapes are
    recalled in PyTorch. `precision` "auto" is the quickest that there is: eight bits through
    OpenVINO unless the processor has AMX, else bfloat16 where it pays. It pickles; what OpenVINO
    compiled is compiled again at its next use.

    Raises `TactileError` where eight bits are asked of a U-Net that cannot run so.
    """

    def __init__(self, unet: TrainedUNet, precision: Precision | Literal["auto"] = "auto") -> None:
        self.device = best_device()
        net = fuse_normalisation(unet.net())
        self._compiled = openvino_pays(net, self.device)
        self._eight_bits = unet.eight_bits
        if precision == "int8" and not (self._compiled and unet.eight_bits):
            raise TactileError(
                "int8 is for large U-Nets on a processor with OpenVINO that were trained since it "
                'was built in: leave precision at "auto", or materialise unet again'
            )
        if precision == "auto":
            precision = self._quickest()
        self.precision = precision
        rough = precision == "bfloat16" or (precision == "int8" and bfloat16_pays(self.device.type))
        self.dtype = torch.bfloat16 if rough else torch.float32  # of what runs through PyTorch
        self.resolution = unet.resolution
        self.free_space = unet.free_space
        self.version = unet.version()
        # OpenVINO is given float32 weights and rounds them itself.
        weights = torch.float32 if self._compiled else self.dtype
        self._net = on_device(net, self.device, weights)
        if self._net.known is not None:
            self._net.known.to(self.dtype)

    def _quickest(self) -> Precision:
        if self._compiled and self._eight_bits and not has_amx():
            return "int8"
        return "bfloat16" if bfloat16_pays(self.device.type) else "float32"

    def __getstate__(self) -> dict[str, object]:
        return {name: value for name, value in vars(self).items() if name != "_engine"}

    @property
    def runs(self) -> str:
        """What it runs on, in words."""
        engine = "OpenVINO" if self._compiled else "PyTorch"
        return f"{engine} on {self.device.type}, {self.precision}"

    @functools.cached_property
    def _engine(self) -> CompiledUNet:
        return CompiledUNet(self._net, self.precision, self.resolution, self._eight_bits)

    @torch.inference_mode()
    def predict(self, felt: np.ndarray) -> np.ndarray:
        """Probability of the object, (N, R, R) float32 in 0–1.

        felt : (N, R, R), 1 at a touch, 0 where nothing is known and, where the U-Net sees
            `free_space`, −1 where a ray has passed
        """
        on_cpu = self.device.type == "cpu"
        batch = LARGEST_CPU_BATCH[self.dtype] if on_cpu else MOST_GPU_PIXELS // self.resolution**2
        forward = self._forward_compiled if self._compiled else self._forward
        parts = [forward(felt[start : start + batch]) for start in range(0, len(felt), batch)]
        return np.concatenate(parts) if parts else np.zeros(felt.shape, np.float32)

    def _forward(self, felt: np.ndarray) -> np.ndarray:
        images = torch.from_numpy(np.ascontiguousarray(felt, dtype=np.int8)).to(self.device)
        logits = self._net(images.to(self.dtype)[:, None])
        return torch.sigmoid(logits.float())[:, 0].cpu().numpy()

    def _forward_compiled(self, felt: np.ndarray) -> np.ndarray:
        images = torch.from_numpy(np.ascontiguousarray(felt, dtype=np.int8))
        windows = self._net.windows(images.float()[:, None]).contiguous()
        start, end = self.resolution // 4, self.resolution - self.resolution // 4
        predictions = np.full(felt.shape, NO_OBJECT, np.float32)
        predictions[:, start:end, start:end] = self._engine.complete(windows.numpy())
        return predictions

    @functools.cached_property
    def single_touches(self) -> np.ndarray | None:
        """Predictions for one touch at each pixel of the middle half, (R/2, R/2, R, R) float32.

        Under random rays two predictions in five are of a first touch, and there are not many
        different ones. None above resolution 64, where the table would outgrow its use.
        """
        if self.resolution > LARGEST_TABLE:
            return None
        half = self.resolution // 2
        felt = np.zeros((half, half, self.resolution, self.resolution), np.int8)
        rows, columns = np.indices((half, half))
        felt[rows, columns, rows + half // 2, columns + half // 2] = 1
        return self.predict(felt.reshape(-1, *felt.shape[2:])).reshape(felt.shape)

    @functools.cached_property
    def untouched(self) -> np.ndarray:
        """The prediction before any touch, (R, R) float32: every episode begins with it."""
        return self.predict(np.zeros((1, self.resolution, self.resolution), np.int8))[0]
