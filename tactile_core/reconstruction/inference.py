"""Fast reconstruction: many touch images in one pass of the U-Net, in the quickest precision."""

import functools
from typing import Literal

import numpy as np
import torch

from tactile_core.reconstruction.trained import TrainedUNet
from tactile_core.reconstruction.unet import fuse_normalisation, on_device

Precision = Literal["auto", "bfloat16", "float32"]

# Larger batches leave the CPU's caches, and do not fit a GPU's memory.
LARGEST_CPU_BATCH = {torch.bfloat16: 256, torch.float32: 64}
MOST_GPU_PIXELS = 2**23  # 128 images at 256×256: some 3 GB in the report's widest net
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


class Reconstructor:
    """A trained U-Net ready to predict; `precision` "auto" takes bfloat16 where it pays."""

    def __init__(self, unet: TrainedUNet, precision: Precision = "auto") -> None:
        self.device = best_device()
        if precision == "auto":
            precision = "bfloat16" if bfloat16_pays(self.device.type) else "float32"
        self.dtype = torch.bfloat16 if precision == "bfloat16" else torch.float32
        self.resolution = unet.resolution
        self.free_space = unet.free_space
        self.version = unet.version()
        self._net = on_device(fuse_normalisation(unet.net()), self.device, self.dtype)

    @torch.inference_mode()
    def predict(self, felt: np.ndarray) -> np.ndarray:
        """Probability of the object, (N, R, R) float32 in 0–1.

        felt : (N, R, R), 1 at a touch, 0 where nothing is known and, where the U-Net sees
            `free_space`, −1 where a ray has passed
        """
        on_cpu = self.device.type == "cpu"
        batch = LARGEST_CPU_BATCH[self.dtype] if on_cpu else MOST_GPU_PIXELS // self.resolution**2
        parts = [self._forward(felt[start : start + batch]) for start in range(0, len(felt), batch)]
        return np.concatenate(parts) if parts else np.zeros(felt.shape, np.float32)

    def _forward(self, felt: np.ndarray) -> np.ndarray:
        images = torch.from_numpy(np.ascontiguousarray(felt, dtype=np.int8)).to(self.device)
        logits = self._net(images.to(self.dtype)[:, None])
        return torch.sigmoid(logits.float())[:, 0].cpu().numpy()

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
