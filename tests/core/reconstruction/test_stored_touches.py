"""Training on the stored touch sets, as the report does."""

import numpy as np
import pandas as pd
import pytest

from tactile_core.dataset.touches import sample_touches
from tactile_core.errors import TactileError
from tactile_core.exploration.practice.ray_touches import touch_source
from tactile_core.reconstruction.stored_touches import stored_touches
from tactile_core.settings import TouchSettings, UNetSettings


@pytest.fixture(scope="module")
def samples(shapes) -> pd.DataFrame:
    """Three touch sets of every shape."""
    tables = [
        pd.DataFrame({
            "sample_id": some.sample_ids, "model_id": some.model_ids,
            "category": some.categories, "split": split,
            "outline": pd.Series(some.outlines, dtype=object),
        })
        for split, some in shapes.items()
    ]  # fmt: skip
    return sample_touches(pd.concat(tables, ignore_index=True), TouchSettings(sets_per_mask=3))


def test_only_stored_sets_are_drawn_and_each_of_them_sooner_or_later(shapes, samples):
    train = shapes["train"]
    source = stored_touches(train, samples.sample(frac=1, random_state=0))
    indices = np.repeat(np.arange(len(train)), 40)
    images = source.draw(np.random.default_rng(0), indices)
    assert (images.shape, images.dtype) == ((len(indices), 64, 64), np.int8)
    for index in range(len(train)):
        stored = {
            tuple(sorted(map(tuple, touches.tolist())))
            for touches in samples.loc[samples["sample_id"] == train.sample_ids[index], "touches"]
        }
        drawn = {
            tuple(map(tuple, np.argwhere(image).tolist())) for image in images[indices == index]
        }
        assert drawn == stored


def test_other_sets_have_another_key(shapes, samples):
    train = shapes["train"]
    key = stored_touches(train, samples).key
    assert key == stored_touches(train, samples).key
    assert key != stored_touches(train, samples[samples["set"] < 2]).key


def test_a_shape_without_a_set_or_with_those_of_another_outline_is_refused(shapes, samples):
    train = shapes["train"]
    one = train.sample_ids[0]
    with pytest.raises(TactileError, match=f"1 samples have no touch set .first: {one}"):
        stored_touches(train, samples[samples["sample_id"] != one])
    off = samples.copy()
    row = int(np.flatnonzero(off["sample_id"] == one)[0])
    off.at[off.index[row], "touches"] = np.zeros((1, 2), np.int16)
    with pytest.raises(TactileError, match="lie off its outline"):
        stored_touches(train, off)


def test_each_kind_of_touches_is_another_source(shapes, samples):
    train = shapes["train"]
    keys = {
        kind: touch_source(kind, train, samples, seed=0).key
        for kind in ("stored", "outline", "rays")
    }
    assert len(set(keys.values())) == 3


def test_a_unet_that_sees_free_space_needs_rays_that_pass():
    with pytest.raises(ValueError, match="free_space: touches 'stored' show no ray"):
        UNetSettings(free_space=True, touches="stored")
