"""Packed masks are the same masks, however many are looked at together."""

import dataclasses
import pickle

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tactile_core.dataset.packed import pack_masks, pack_pictures
from tactile_core.dataset.rendering import pictures
from tactile_core.dataset.rendering.pictures import decode_masks, decoded, encode_mask
from tactile_core.errors import TactileError

many_masks = st.integers(1, 5).flatmap(lambda count: arrays(bool, (count, 16, 16)))


@settings(deadline=None)
@given(masks=many_masks, inside=st.booleans(), data=st.data())
def test_they_are_indexed_as_an_array_would_be(masks, inside, data):
    if inside:  # the middle half, where shapes lie
        masks = np.pad(masks[:, 4:12, 4:12], ((0, 0), (4, 4), (4, 4)))
    packed = pack_masks(masks)
    assert len(packed) == len(masks) and packed.shape == masks.shape
    indices = np.array(data.draw(st.lists(st.integers(-len(masks), len(masks) - 1))), int)
    part = data.draw(st.slices(len(masks)))
    for which in (0, indices, part, slice(None)):
        np.testing.assert_array_equal(packed[which], masks[which])
        assert packed[which].dtype == bool
    np.testing.assert_array_equal(packed.select(indices)[:], masks[indices])
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(packed))[:], masks)


def test_masks_in_the_middle_half_take_a_bit_for_each_of_its_pixels():
    masks = np.zeros((3, 64, 64), bool)
    masks[:, 16:48, 16:48] = True
    assert pack_masks(masks).bits.nbytes == 3 * 32 * 32 / 8
    masks[1, 15, 20] = True
    assert pack_masks(masks).bits.nbytes == 3 * 64 * 64 / 8


def test_portions_cover_all_masks_in_order(shapes, monkeypatch):
    masks = shapes["train"].masks
    drawn = pd.Series(map(encode_mask, masks), index=range(5, 5 + len(masks)))
    monkeypatch.setattr(pictures, "AT_A_TIME", 7)
    for portions in (decoded(drawn), pack_pictures(drawn).portions()):
        portions = list(portions)
        assert [len(some) for some in portions] == [7, 7, 7, 3]
        np.testing.assert_array_equal(np.concatenate(portions), masks)


def test_shapes_have_one_version_however_their_masks_are_packed(shapes):
    train = shapes["train"]
    masks = train.masks
    masks[0, 0, 0] = True
    whole = dataclasses.replace(train, packed=pack_masks(masks))
    masks[0, 0, 0] = False
    whole.packed.bits[0, 0] = 0
    assert whole.packed.bits.shape != train.packed.bits.shape
    assert whole.version == train.version
    whole.packed.bits[3, 100] ^= 1
    assert dataclasses.replace(whole).version != train.version


def test_pictures_of_two_resolutions_are_refused(shapes):
    small = encode_mask(np.ones((48, 48), bool))
    drawn = pd.Series([*map(encode_mask, shapes["test"].masks), small])
    for read in (decode_masks, pack_pictures):
        with pytest.raises(TactileError, match="materialise masks and rotated_splits again"):
            read(drawn)
