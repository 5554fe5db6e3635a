"""Fast reconstruction says what the plain net says."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_core.reconstruction.batches import outline_touches, touch_images
from tactile_core.reconstruction.inference import Reconstructor
from tactile_core.reconstruction.jaccard import jaccard_index
from tactile_core.reconstruction.trained import TrainedUNet


@pytest.fixture(scope="module")
def touches(shapes) -> np.ndarray:
    """Touch images (24, R, R) of the train shapes."""
    points, held = outline_touches(shapes["train"])(np.random.default_rng(0), np.arange(24))
    return touch_images(points, held, 64)


@pytest.fixture(scope="module", params=["unet", "knowing_unet"])
def either_unet(request) -> TrainedUNet:
    """One after the other: a U-Net that knows no shapes, and one that does."""
    return request.getfixturevalue(request.param)


def test_a_reconstruction_is_the_sigmoid_of_the_plain_net(either_unet, touches):
    with torch.no_grad():
        logits = either_unet.net()(torch.from_numpy(touches).float()[:, None])
    expected = torch.sigmoid(logits)[:, 0].numpy()
    found = Reconstructor(either_unet, "float32").predict(touches)
    np.testing.assert_allclose(found, expected, atol=1e-4)


def test_half_precision_reconstructs_the_same_shapes(either_unet, touches, shapes):
    masks = shapes["train"].masks
    exact, halved = (
        jaccard_index(Reconstructor(either_unet, precision).predict(touches), masks)
        for precision in ("float32", "bfloat16")
    )
    assert abs(exact.mean() - halved.mean()) < 0.5
    assert np.abs(exact - halved).max() < 5


@settings(deadline=None, max_examples=15)
@given(cuts=st.lists(st.integers(0, 24), max_size=3))
def test_it_does_not_matter_how_images_are_cut_into_batches(reconstructor, touches, cuts):
    parts = np.split(touches, sorted(cuts))
    pieces = np.concatenate([reconstructor.predict(part) for part in parts])
    np.testing.assert_allclose(pieces, reconstructor.predict(touches), atol=1e-5)


def test_more_images_than_one_batch_holds_come_back_in_order(reconstructor, touches):
    many = np.concatenate([touches] * 11)  # 264, and 256 make a batch on the CPU
    predictions = reconstructor.predict(many)
    np.testing.assert_allclose(predictions[240:], reconstructor.predict(touches), atol=1e-5)


def test_no_images_give_no_predictions(reconstructor):
    assert reconstructor.predict(np.zeros((0, 64, 64), np.uint8)).shape == (0, 64, 64)


def test_before_any_touch_the_prediction_is_that_of_an_empty_image(reconstructor):
    empty = np.zeros((1, 64, 64), np.uint8)
    np.testing.assert_array_equal(reconstructor.untouched, reconstructor.predict(empty)[0])


def test_bool_and_integer_touches_are_the_same(reconstructor, touches):
    np.testing.assert_array_equal(
        reconstructor.predict(touches.astype(bool)), reconstructor.predict(touches)
    )
