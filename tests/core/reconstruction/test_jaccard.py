"""The metric of the report (section V)."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tactile_core.reconstruction.jaccard import jaccard_index

probabilities = arrays(
    np.float32, (3, 5, 5), elements=st.sampled_from([0.0, 0.25, 0.5, 0.5625, 1.0])
)
masks = arrays(bool, (3, 5, 5))


@given(probabilities, masks)
def test_the_jaccard_index_is_overlap_by_union_of_the_two_sets_of_pixels(predictions, masks):
    expected = []
    for prediction, mask in zip(predictions, masks, strict=True):
        predicted = {tuple(pixel) for pixel in np.argwhere(prediction > 0.5)}
        true = {tuple(pixel) for pixel in np.argwhere(mask)}
        both = len(predicted & true)
        expected.append(100 * both / len(predicted | true) if predicted | true else 100)
    assert jaccard_index(predictions, masks) == pytest.approx(expected)


def test_nothing_predicted_of_nothing_is_perfect():
    assert jaccard_index(np.zeros((4, 4)), np.zeros((4, 4), bool)) == 100


def test_one_prediction_is_compared_with_every_mask():
    prediction = np.array([[1.0, 1.0], [0.0, 0.0]])
    masks = np.array([[[1, 1], [0, 0]], [[1, 0], [0, 0]], [[0, 0], [1, 1]]], bool)
    assert jaccard_index(prediction, masks).tolist() == [100, 50, 0]
