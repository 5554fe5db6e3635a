"""What PPO's policy reads from an observation."""

import numpy as np
import pytest
import torch
from gymnasium import spaces
from stable_baselines3.common.torch_layers import NatureCNN

from tactile_core.exploration.policies import features
from tactile_core.exploration.policies.features import WindowCNN


def observations(resolution: int, low: float, high: float) -> torch.Tensor:
    """Noise (3, 2, R, R), 0–255, between two shares of the image, nothing elsewhere."""
    images = torch.zeros(3, 2, resolution, resolution)
    inside = slice(int(low * resolution), int(high * resolution))
    noise = 255 * torch.rand(images.shape, generator=torch.Generator().manual_seed(0))
    images[..., inside, inside] = noise[..., inside, inside]
    return images


def window_cnn(resolution: int) -> WindowCNN:
    torch.manual_seed(0)
    return WindowCNN(spaces.Box(0, 255, (2, resolution, resolution), np.uint8))


@pytest.mark.parametrize("resolution", [48, 64, 96, 128, 256])
def test_all_of_the_middle_half_is_read(resolution):
    images = observations(resolution, 0.25, 0.75).requires_grad_()
    features = window_cnn(resolution)(images)
    assert features.shape == (3, 512)
    features.sum().backward()
    middle = slice(resolution // 4, -resolution // 4)
    assert (images.grad[..., middle, middle] != 0).float().mean() > 0.9


@pytest.mark.parametrize("resolution", [64, 256])
def test_nothing_near_the_border_is_read(resolution):
    cnn = window_cnn(resolution)
    images = observations(resolution, 0, 0.1)
    assert torch.equal(cnn(images), cnn(torch.zeros_like(images)))


@pytest.mark.parametrize("pays", [True, False])
def test_at_the_lowest_resolution_it_reads_as_much_as_nature_cnn_needs(monkeypatch, pays):
    """Nearly to the bit in float32, and nearly so in bfloat16: layouts differ."""
    monkeypatch.setattr(features, "bfloat16_pays", lambda device: pays)
    torch.manual_seed(0)
    plain = NatureCNN(spaces.Box(0, 1, (2, 36, 36), np.float32), normalized_image=True)
    images = observations(48, 0.25, 0.75)
    found, wanted = window_cnn(48)(images), plain(images[..., 6:42, 6:42] / 255)
    assert found.dtype == torch.float32
    torch.testing.assert_close(found, wanted, rtol=0, atol=0.005 if pays else 1e-6)
