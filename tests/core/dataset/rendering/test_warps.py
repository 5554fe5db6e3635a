import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tactile_core.dataset.rendering.warps import warp
from tactile_core.settings import LARGEST_SEED

seeds = st.integers(1, LARGEST_SEED)
vertices = arrays(np.float64, (12, 3), elements=st.floats(-0.5, 0.5)).filter(
    lambda points: np.ptp(points, axis=0).min() > 0.05
)


@given(vertices, seeds)
def test_a_warped_mesh_is_centred_and_scaled_as_every_mesh_is(points, seed):
    low, high = (edge(warp(points, seed), axis=0) for edge in (np.min, np.max))
    assert low + high == pytest.approx(0, abs=1e-12)
    assert np.linalg.norm(high - low) == pytest.approx(1)


@given(vertices, seeds)
def test_a_warp_depends_on_its_seed_only_and_zero_is_none(points, seed):
    assert (warp(points, seed) == warp(points, seed)).all()
    assert not np.allclose(warp(points, seed), warp(points, seed + 1))
    assert (warp(points, 0) == points).all()


@given(seeds)
def test_neighbouring_points_stay_neighbours(seed):
    """A bend may not tear: along a fine line no step is ten times as long as it was."""
    line = np.linspace(-1, 1, 201)[:, None] * np.full(3, 0.5 / np.sqrt(3))
    before = np.linalg.norm(np.diff(line, axis=0), axis=1).max()
    assert np.linalg.norm(np.diff(warp(line, seed), axis=0), axis=1).max() < 10 * before
