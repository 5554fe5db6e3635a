"""A U-Net through OpenVINO says what PyTorch says."""

import pickle
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pandas as pd
import pytest
import torch

from tactile_core.reconstruction import engines
from tactile_core.reconstruction.batches import felt_outlines
from tactile_core.reconstruction.eight_bits import with_eight_bits
from tactile_core.reconstruction.folded import FEWEST_WEIGHTS
from tactile_core.reconstruction.inference import Reconstructor
from tactile_core.reconstruction.known_shapes import pack
from tactile_core.reconstruction.trained import TrainedUNet
from tactile_core.reconstruction.unet import UNet

pytest.importorskip("openvino")


@pytest.fixture(scope="module", params=[False, True], ids=["touches", "known"])
def large_unet(request, shapes) -> TrainedUNet:
    """Large enough for OpenVINO, with random weights that tell images apart."""
    torch.manual_seed(0)
    known = pack(shapes["train"].masks) if request.param else None
    net = UNet(3, 16)
    if known is not None:
        net.contract[0][0] = torch.nn.Conv2d(2, 16, 3, padding=1, bias=False)
    for name, value in net.state_dict().items():
        if value.dim() == 4:
            value.normal_(0, 1.0 / value[0].numel() ** 0.5)
        elif name.endswith(("running_var", "running_mean", "bias")):
            value.uniform_(0.1, 0.4)
    weights = {name: value.contiguous() for name, value in net.state_dict().items()}
    assert sum(weight.numel() for weight in net.parameters()) >= FEWEST_WEIGHTS
    unet = TrainedUNet(weights, 64, 3, 16, {"seed": 0}, {}, pd.DataFrame(), pd.DataFrame(), known)
    return with_eight_bits(unet, shapes["train"], felt_outlines(shapes["train"]))


@pytest.fixture(scope="module")
def felt(shapes) -> np.ndarray:
    """Images (150, R, R) int8 of a few touched pixels each."""
    rng = np.random.default_rng(0)
    images = np.zeros((150, 64, 64), np.int8)
    rows, columns = rng.integers(16, 48, (2, 150, 4))
    images[np.arange(150)[:, None], rows, columns] = 1
    return images


def in_pytorch(unet: TrainedUNet, felt: np.ndarray) -> np.ndarray:
    with torch.no_grad():
        return torch.sigmoid(unet.net()(torch.from_numpy(felt).float()[:, None]))[:, 0].numpy()


def test_float32_gives_the_probabilities_of_the_plain_net(large_unet, felt):
    reconstructor = Reconstructor(large_unet, "float32")
    assert "OpenVINO" in reconstructor.runs
    expected = in_pytorch(large_unet, felt)
    assert expected.std() > 0.05
    np.testing.assert_allclose(reconstructor.predict(felt), expected, atol=1e-4)


@pytest.mark.parametrize("precision", ["bfloat16", "int8"])
def test_fewer_bits_give_them_nearly(large_unet, felt, precision):
    reconstructor = Reconstructor(large_unet, precision)
    assert reconstructor.runs == f"OpenVINO on cpu, {precision}"
    assert np.abs(reconstructor.predict(felt) - in_pytorch(large_unet, felt)).mean() < 0.01


@pytest.mark.parametrize("precision", ["float32", "bfloat16"])
def test_a_prediction_does_not_hang_on_what_else_is_in_the_batch(large_unet, felt, precision):
    reconstructor = Reconstructor(large_unet, precision)
    whole = reconstructor.predict(felt)
    for size in (1, 7, 17, 40, 70):
        np.testing.assert_allclose(reconstructor.predict(felt[:size]), whole[:size], atol=1e-5)
        np.testing.assert_allclose(reconstructor.predict(felt[-size:]), whole[-size:], atol=1e-5)


def test_a_reconstructor_that_was_used_pickles(large_unet, felt):
    reconstructor = Reconstructor(large_unet)
    before = reconstructor.predict(felt[:5])
    again = pickle.loads(pickle.dumps(reconstructor))
    np.testing.assert_array_equal(again.predict(felt[:5]), before)


def test_threads_compile_one_at_a_time(large_unet, felt, monkeypatch):
    plain, busy, met = engines.graph, threading.Lock(), []

    def slow(*given):
        met.append(busy.acquire(blocking=False))
        time.sleep(0.2)
        if met[-1]:
            busy.release()
        return plain(*given)

    monkeypatch.setattr(engines, "graph", slow)
    with ThreadPoolExecutor(3) as pool:
        each = [Reconstructor(large_unet) for _ in range(3)]
        found = list(pool.map(lambda reconstructor: reconstructor.predict(felt[:8]), each))
    assert met == [True, True, True]
    np.testing.assert_array_equal(found[0], found[1])


def test_small_nets_stay_in_pytorch(unet):
    assert "PyTorch" in Reconstructor(unet).runs
