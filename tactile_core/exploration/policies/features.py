"""What PPO's CnnPolicy reads from an observation."""

from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.torch_layers import NatureCNN
from torch import Tensor

from tactile_core.reconstruction.inference import bfloat16_pays

MARGIN = 6  # pixels of empty space kept around the part that a shape can reach


class WindowCNN(NatureCNN):
    """SB3's NatureCNN on the middle of the image, where alone there is anything to see.

    No shape leaves the middle half of the image (see `reconstruction.unet`): convolving the
    empty rest would take most of the time of an update. In bfloat16 where the processor has it.

    It is given grey values 0–255 (see `READS_THE_WINDOW`) and divides those of the middle only.
    """

    def __init__(
        self,
        observation_space: spaces.Box,
        features_dim: int = 512,
        normalized_image: bool = True,
    ) -> None:
        channels, resolution, _ = observation_space.shape
        # NatureCNN needs 36 pixels at least.
        margin = max(0, min(resolution // 4 - MARGIN, (resolution - 36) // 2))
        side = resolution - 2 * margin
        window = spaces.Box(0, 255, (channels, side, side), np.uint8)
        super().__init__(window, features_dim, normalized_image)
        self.margin = margin

    def forward(self, observations: Tensor) -> Tensor:
        end = observations.shape[-1] - self.margin
        window = observations[..., self.margin : end, self.margin : end] / 255
        window = window.contiguous(memory_format=torch.channels_last)
        device = window.device.type
        with torch.autocast(device, torch.bfloat16, enabled=bfloat16_pays(device)):
            return super().forward(window).float()


# Of SB3's CnnPolicy: it would divide the whole image by 255.
READS_THE_WINDOW: dict[str, Any] = {
    "features_extractor_class": WindowCNN,
    "normalize_images": False,
}
