"""The Jaccard index |O∩L| / |O∪L| in percent, the metric of the report (section V)."""

import numpy as np

THRESHOLD = 0.5


def jaccard_index(predictions: np.ndarray, masks: np.ndarray) -> np.ndarray:
    """Jaccard index (0–100, float32) of each prediction with its mask.

    predictions : (..., R, R) float, probability of the object, thresholded at 0.5
    masks : (..., R, R) bool, broadcast against the predictions

    Where neither holds a pixel, the index is 100.
    """
    predicted = predictions > THRESHOLD
    overlap = np.count_nonzero(predicted & masks, axis=(-2, -1))
    union = np.count_nonzero(predicted | masks, axis=(-2, -1))
    return np.where(union == 0, 100.0, 100.0 * overlap / np.maximum(union, 1)).astype(np.float32)
