"""The net itself (report, section V, Figure 1)."""

import copy

import pytest
import torch

from tactile_core.errors import TactileError
from tactile_core.reconstruction.unet import UNet, fuse_normalisation


def touched(resolution: int, count: int = 2) -> torch.Tensor:
    """Images (count, 1, R, R) with a few touches in the middle half."""
    random = torch.Generator().manual_seed(0)
    images = torch.zeros(count, 1, resolution, resolution)
    low, high = resolution // 4, 3 * resolution // 4
    for image in images:
        rows, columns = torch.randint(low, high, (2, 5), generator=random)
        image[0, rows, columns] = 1
    return images


def trained_a_little(depth: int = 3, channels: int = 4) -> UNet:
    """A net whose batch normalisations have seen data, in eval mode."""
    torch.manual_seed(0)
    net = UNet(depth, channels)
    for _ in range(3):
        net(torch.rand(4, 1, 64, 64))
    return net.eval()


@pytest.mark.parametrize(("resolution", "depth"), [(32, 1), (32, 4), (48, 4), (64, 6), (80, 3)])
def test_logits_have_the_shape_of_the_touches(resolution, depth):
    touches = touched(resolution)
    assert UNet(depth, 2).eval()(touches).shape == touches.shape


def test_outside_the_middle_half_there_is_no_object_whatever_the_weights():
    probability = torch.sigmoid(trained_a_little()(touched(64)))
    inside = torch.zeros(64, 64, dtype=torch.bool)
    inside[16:48, 16:48] = True
    assert (probability[..., ~inside] < 1e-6).all()
    assert (probability[..., inside] > 1e-6).all()


def test_a_touch_outside_the_middle_half_changes_nothing():
    net = trained_a_little()
    touches = touched(64)
    beyond = touches.clone()
    beyond[..., 3, 60] = 1
    assert torch.equal(net(touches), net(beyond))


def test_each_level_has_twice_the_channels_of_the_one_above():
    widths = [block[0].out_channels for block in UNet(4, 6).contract]
    assert widths == [6, 12, 24, 48]


def test_every_level_has_a_say_in_the_output():
    net = UNet(4, 4)
    net(touched(64)).sum().backward()
    assert all(p.grad is not None and p.grad.abs().sum() > 0 for p in net.parameters())


def test_what_a_level_saw_reaches_the_output_past_the_deeper_ones():
    net = trained_a_little()
    for raise_ in net.raise_:
        torch.nn.init.zeros_(raise_.weight)
        torch.nn.init.zeros_(raise_.bias)
    assert not torch.equal(net(touched(64)), net(torch.zeros(2, 1, 64, 64)))


@pytest.mark.parametrize(("resolution", "depth"), [(48, 5), (64, 7), (80, 5)])
def test_a_depth_that_does_not_fit_the_resolution_is_refused(resolution, depth):
    with pytest.raises(TactileError, match=f"depth {depth} .*choose a smaller depth"):
        UNet(depth, 1).eval()(touched(resolution))


def test_fusing_the_normalisations_leaves_the_output_as_it_was():
    net = trained_a_little()
    fused = fuse_normalisation(copy.deepcopy(net))
    assert not any(isinstance(module, torch.nn.BatchNorm2d) for module in fused.modules())
    torch.testing.assert_close(fused(touched(64)), net(touched(64)))
