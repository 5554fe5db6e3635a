import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_core.dataset.shapes import as_points
from tactile_core.dataset.touches import rasterise_touches, sample_touches
from tactile_core.errors import TactileError
from tactile_core.parquet import read_table, table_hash, write_table
from tactile_core.settings import LARGEST_SEED, TouchSettings


def outlines(count=4, points=30):
    ids = [f"model{number // 2}-r{number % 2}" for number in range(count)]
    return pd.DataFrame(
        {
            "sample_id": ids,
            "model_id": [name.split("-")[0] for name in ids],
            "category": "mug",
            "split": "train",
            "outline": [
                np.stack([np.arange(points) + number, np.arange(points)], axis=1).astype(np.int16)
                for number in range(count)
            ],
        }
    )


SEEDS = st.integers(0, LARGEST_SEED)


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 6), st.integers(0, 6), st.integers(1, 4), st.integers(1, 8), SEEDS)
def test_a_set_holds_different_outline_points_within_the_bounds(few, more, sets, points, seed):
    given_outlines = outlines(points=points)
    bounds = TouchSettings(fewest=few, most=max(few + more, 1), sets_per_mask=sets, seed=seed)
    samples = sample_touches(given_outlines, bounds)
    assert samples["set"].tolist() == list(range(sets)) * len(given_outlines)
    by_sample = given_outlines.set_index("sample_id")["outline"]
    for row in samples.itertuples():
        touches = set(map(tuple, row.touches))
        assert len(touches) == len(row.touches)
        assert min(few, points) <= len(touches) <= min(bounds.most, points)
        assert touches <= set(map(tuple, by_sample[row.sample_id]))


def test_every_size_from_fewest_to_most_is_equally_likely():
    samples = sample_touches(outlines(), TouchSettings(sets_per_mask=500))
    counts = samples["touches"].map(len).value_counts()
    assert set(counts.index) == set(range(1, 11))
    assert 140 < counts.min() <= counts.max() < 260  # 200 expected, standard deviation 13


def test_every_outline_point_is_equally_likely():
    samples = sample_touches(outlines(count=1), TouchSettings(sets_per_mask=2000, most=1))
    rows = np.concatenate(list(samples["touches"]))[:, 0]
    counts = np.bincount(rows, minlength=30)
    assert 30 < counts.min() <= counts.max() < 110  # 67 expected, standard deviation 8


def test_sets_depend_on_the_seed_and_their_own_sample_only():
    bounds = TouchSettings(seed=3)
    everything = sample_touches(outlines(), bounds)
    assert table_hash(everything) == table_hash(sample_touches(outlines(), bounds))
    alone = sample_touches(outlines().iloc[[2]], bounds)
    of_sample = everything[everything["sample_id"] == "model1-r0"].reset_index(drop=True)
    assert table_hash(alone) == table_hash(of_sample)
    other = sample_touches(outlines(), bounds.model_copy(update={"seed": 4}))
    assert table_hash(everything) != table_hash(other)


def test_touches_are_stored_as_lists_of_pairs(tmp_path):
    samples = sample_touches(outlines(), TouchSettings(fewest=0, sets_per_mask=20))
    write_table(samples, tmp_path / "touches.parquet")
    pairs = pa.list_(pa.list_(pa.int16(), 2))
    assert pq.read_schema(tmp_path / "touches.parquet").field("touches").type == pairs
    stored = read_table(tmp_path / "touches.parquet")
    assert table_hash(stored) == table_hash(samples)
    assert min(stored["touches"].map(len)) == 0
    for ours, theirs in zip(samples["touches"], stored["touches"], strict=True):
        assert as_points(theirs).tolist() == ours.tolist()


@settings(deadline=None)
@given(st.lists(st.lists(st.tuples(st.integers(0, 15), st.integers(0, 15))), max_size=4))
def test_an_image_shows_its_touches_and_nothing_else(sets):
    images = rasterise_touches([np.array(points).reshape(-1, 2) for points in sets], 16)
    assert images.shape == (len(sets), 16, 16)
    assert [set(map(tuple, np.argwhere(image).tolist())) for image in images] == list(
        map(set, sets)
    )


@pytest.mark.parametrize("point", [(16, 0), (0, 16), (-1, 3)])
def test_touches_of_another_resolution_are_refused(point):
    with pytest.raises(TactileError, match=r"outside a 16×16 image.*another resolution"):
        rasterise_touches([np.array([(1, 1)]), np.array([point])], 16)
