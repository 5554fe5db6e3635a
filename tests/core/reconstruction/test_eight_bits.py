"""A U-Net in eight bits: ranges are measured after training, stored, and used where that pays."""

import dataclasses

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from upath import UPath

import tactile_core
from benchmarks.precision import from_platform
from tactile_core.dataset.outlines import trace_outlines
from tactile_core.dataset.shapes import load_shapes
from tactile_core.errors import TactileError
from tactile_core.exploration.practice.ray_touches import touch_source
from tactile_core.parquet import read_table
from tactile_core.reconstruction import inference
from tactile_core.reconstruction.batches import training_batches
from tactile_core.reconstruction.eight_bits import RARE, highest, levels, with_eight_bits
from tactile_core.reconstruction.inference import Reconstructor
from tactile_core.reconstruction.jaccard import jaccard_index
from tactile_core.reconstruction.trained import load_unet, save_unet
from tactile_core.reconstruction.unet import fuse_normalisation

pytest.importorskip("openvino")
SHIPPED = UPath(tactile_core.__file__).parent / "pretrained"


@pytest.fixture(scope="module")
def of_split():
    """The shapes that the shipped U-Net goes with, by split."""
    table = read_table(SHIPPED / "rotated_splits.parquet")
    outlines = trace_outlines(table)
    return {split: load_shapes(table, outlines, split) for split in ("train", "test")}


@pytest.fixture(scope="module")
def measured(of_split):
    """The shipped U-Net with what eight bits need, measured as at the end of a training."""
    touches = touch_source("rays", of_split["train"], None, seed=0, free_space=True)
    return with_eight_bits(load_unet(SHIPPED / "unet"), of_split["train"], touches.draw)


@pytest.fixture(scope="module")
def felt_and_masks(of_split):
    """What rays and touches on test shapes leave felt, and the shapes."""
    test = of_split["test"]
    draw = touch_source("rays", test, None, seed=1, free_space=True).draw
    parts = list(training_batches(test, 64, np.random.default_rng(1), draw))
    return np.concatenate([felt for _, felt, _ in parts]), np.concatenate([m for *_, m in parts])


def test_test_shapes_are_reconstructed_as_well_as_in_float32(measured, felt_and_masks):
    felt, masks = felt_and_masks
    exact, rough = (
        jaccard_index(Reconstructor(measured, precision).predict(felt), masks)
        for precision in ("float32", "int8")
    )
    assert exact.mean() > 70
    assert abs(exact.mean() - rough.mean()) < 0.1
    assert np.abs(exact - rough).mean() < 0.5
    assert (exact != rough).any()


def test_they_are_stored_with_the_weights_and_count_for_the_version(measured, tmp_path):
    save_unet(measured, UPath(tmp_path))
    again = load_unet(UPath(tmp_path))
    assert again.version() == measured.version()
    assert again.eight_bits.keys() == measured.eight_bits.keys() != set()
    for name, value in measured.eight_bits.items():
        assert torch.equal(again.eight_bits[name], value)
    assert again.weights.keys() == measured.weights.keys()
    assert dataclasses.replace(measured, eight_bits={}).version() != measured.version()


@pytest.mark.parametrize(
    ("bfloat16", "amx", "runs", "unmeasured"),
    [
        (True, True, "bfloat16", "bfloat16"),
        (True, False, "int8", "bfloat16"),
        (False, False, "int8", "float32"),
    ],
)
def test_they_are_used_where_the_processor_has_no_amx(
    measured, monkeypatch, bfloat16, amx, runs, unmeasured
):
    monkeypatch.setattr(inference, "bfloat16_pays", lambda device: bfloat16)
    monkeypatch.setattr(inference, "has_amx", lambda: amx)
    assert Reconstructor(measured).runs == f"OpenVINO on cpu, {runs}"
    without = dataclasses.replace(measured, eight_bits={})
    assert Reconstructor(without).runs == f"OpenVINO on cpu, {unmeasured}"


def test_eight_bits_that_were_not_measured_are_refused(unet):
    with pytest.raises(TactileError, match="materialise unet again"):
        Reconstructor(unet, "int8")


def test_small_nets_are_not_measured(unet):
    assert unet.eight_bits == {}


def test_the_bench_compares_another_net_where_the_platform_s_is_small(unet, tmp_path, monkeypatch):
    monkeypatch.delenv("DAGSTER_HOME", raising=False)
    monkeypatch.setenv("TACTILE_HOME", str(tmp_path))
    save_unet(unet, UPath(tmp_path / "artifacts" / "unet"))
    with pytest.raises(TactileError, match="too small, or too old, for eight bits"):
        from_platform()


def test_the_first_convolution_stays_as_it_is_and_all_others_are_measured(measured):
    net = fuse_normalisation(measured.net())
    convolutions = [layer for layer in net.modules() if isinstance(layer, torch.nn.Conv2d)]
    # Where the image is doubled, one convolution is two.
    assert len(measured.eight_bits) == len(convolutions) + len(net.expand) - 1
    assert "contract.0.0" not in measured.eight_bits


@given(st.floats(0, 1000, width=32), st.booleans())
def test_nought_is_one_of_the_levels(high, signed):
    low, high = levels(torch.tensor(high), signed).double().numpy()
    step = (high - low) / 255
    assert abs(low / step - round(low / step)) < 1e-3
    assert (low < 0) == signed


@given(st.integers(1, 3), st.integers(0, 2**32 - 1))
def test_but_for_rare_values_all_lie_within_the_levels(hundred_thousands, seed):
    values = np.random.default_rng(seed).normal(size=hundred_thousands * RARE).astype("f4")
    beyond = np.abs(values) > highest(torch.from_numpy(values)).item()
    assert beyond.sum() == hundred_thousands - 1


def test_a_few_values_all_lie_within_them():
    assert highest(torch.tensor([1.0, -3.0, 2.0])) == 3
