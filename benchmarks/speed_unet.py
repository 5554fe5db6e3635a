"""The U-Net: how near inference comes to the machine's limit, and how much faster it trains."""

import numpy as np
import torch
from torch import nn
from torch.nn import functional
from torch.utils.flop_counter import FlopCounterMode

from benchmarks.samples import CHANNELS, DEPTH, RESOLUTION, masks, shapes, untrained
from benchmarks.timing import Pace, Row, Work, alternated, at_least, rate
from tactile_core.dataset.shapes import Shapes
from tactile_core.profiles import PROFILES
from tactile_core.reconstruction.batches import felt_outlines, training_batches
from tactile_core.reconstruction.engines import Precision
from tactile_core.reconstruction.epoch import PARTS, begin_training, train_epoch
from tactile_core.reconstruction.inference import Reconstructor, best_device, bfloat16_pays
from tactile_core.reconstruction.unet import UNet

BATCH = PROFILES["laptop"].policies.environments
TRAINING_BATCH = 32
LEARNING_RATE = 1e-3
PRODUCT_SIZES = {"cpu": (512, 1024, 2048), "cuda": (4096, 8192)}


def unet_rows(pace: Pace) -> list[Row]:
    """Inference as a share of the matrix-product rate, in eight bits beside what else would run,
    and training beside a plain loop."""
    precision: Precision = "bfloat16" if bfloat16_pays(best_device().type) else "float32"
    usual = Reconstructor(untrained(), precision)
    share = alternated(predictions(usual), best_product(usual.dtype), pace)
    some = shapes(masks())
    return [
        at_least(
            f"U-Net inference, batch {BATCH}, {precision}, beside a matrix product (share)",
            share, "GFLOP/s", goal=0.6,
        ),
        *eight_bits_rows(usual, pace),
        at_least(
            f"U-Net training, batch {TRAINING_BATCH}, beside a plain float32 loop",
            alternated(our_training(some), plain_training(some), pace), "images/s", goal=2.5,
        ),
        at_least(
            f"U-Net training, batch {TRAINING_BATCH}, beside a float32 loop over the middle half",
            alternated(our_training(some), plain_training(some, cropped=True), pace), "images/s",
        ),
        at_least(
            f"U-Net training, batch {TRAINING_BATCH}, in two halves on two threads beside whole",
            alternated(our_training(some, parts=PARTS), our_training(some), pace), "images/s",
        ),
    ]  # fmt: skip


def eight_bits_rows(usual: Reconstructor, pace: Pace) -> list[Row]:
    if best_device().type != "cpu":
        return []
    eight_bits = Reconstructor(untrained(), "int8")
    rates = alternated(predictions(eight_bits), predictions(usual), pace)
    what = f"U-Net inference, batch {BATCH}, int8 beside {usual.precision}"
    return [at_least(what, rates, "GFLOP/s")]


def predictions(reconstructor: Reconstructor) -> Work:
    """One batch through `predict`, with all that is around the net; counted in GFLOP."""
    touches = np.zeros((BATCH, RESOLUTION, RESOLUTION), np.uint8)
    touches[:, RESOLUTION // 2, RESOLUTION // 4 : 3 * RESOLUTION // 4 : 3] = 1
    counter = FlopCounterMode(display=False)
    with counter, torch.no_grad():
        untrained().net()(torch.zeros(BATCH, 1, RESOLUTION, RESOLUTION))
    billions = counter.get_total_flops() / 1e9

    def work() -> float:
        reconstructor.predict(touches)
        return billions

    return work


def best_product(dtype: torch.dtype) -> Work:
    """The square matrix product that this machine is quickest at; counted in GFLOP."""
    works = [matrix_product(size, dtype) for size in PRODUCT_SIZES[best_device().type]]
    for work in works:
        work()
    return max(works, key=lambda work: rate(work, 0.2))


def matrix_product(size: int, dtype: torch.dtype) -> Work:
    a = torch.randn(size, size, device=best_device()).to(dtype)
    out = torch.empty_like(a)

    def work() -> float:
        torch.mm(a, a, out=out)
        return 2 * size**3 / 1e9

    return work


def our_training(some: Shapes, parts: int = 1) -> Work:
    """An epoch of `train_epoch`."""
    training = begin_training(DEPTH, CHANNELS, LEARNING_RATE, seed=0)

    def work() -> float:
        train_epoch(training, some, TRAINING_BATCH, felt_outlines(some), parts=parts)
        return len(some)

    return work


def plain_training(some: Shapes, cropped: bool = False) -> Work:
    """The same epoch on the same batches as one writes it first: float32 in the usual layout, over
    the whole image, as the report's net sees it.

    Ours sees the middle half only, so the images are set in a frame as wide as half of them: that
    half is then the image itself. `cropped` leaves them as they are, and the plain loop a quarter
    of the work.
    """
    frame = [0 if cropped else RESOLUTION // 2] * 4
    device = best_device()
    torch.manual_seed(0)
    net = UNet(DEPTH, CHANNELS).to(device)
    optimizer = torch.optim.AdamW(net.parameters(), lr=LEARNING_RATE, weight_decay=1e-4)
    rng = np.random.default_rng(0)

    def work() -> float:
        for _, felt, labels in training_batches(some, TRAINING_BATCH, rng, felt_outlines(some)):
            inputs = torch.from_numpy(felt).to(device, torch.float32)[:, None]
            wanted = torch.from_numpy(labels).to(device, torch.float32)[:, None]
            inputs, wanted = functional.pad(inputs, frame), functional.pad(wanted, frame)
            loss = functional.binary_cross_entropy_with_logits(net(inputs), wanted)
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(net.parameters(), 1.0)
            optimizer.step()
            loss.item()
        return len(some)

    return work
