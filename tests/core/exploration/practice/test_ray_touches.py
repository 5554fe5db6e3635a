"""What rays feel, as the U-Net's training draws it."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_core.exploration.practice.ray_touches import (
    RAYS,
    SEQUENCES,
    plain_sequences,
    rays_and_outlines,
)
from tactile_core.exploration.world.rays import cast_rays, mark_free


@settings(deadline=None, max_examples=10)
@given(seed=st.integers(0, 2**32 - 1))
def test_images_show_touches_on_the_outline_and_free_space_off_the_shape(shapes, seed):
    train = shapes["train"]
    indices = np.random.default_rng(seed).integers(len(train), size=64)
    felt = rays_and_outlines(train, seed, free_space=True).draw(
        np.random.default_rng(seed), indices
    )
    assert (felt.shape, felt.dtype) == ((64, 64, 64), np.int8)
    assert set(np.unique(felt)) == {-1, 0, 1}
    for image, index in zip(felt, indices, strict=True):
        outline = set(map(tuple, train.outlines[index].tolist()))
        assert set(map(tuple, np.argwhere(image == 1).tolist())) <= outline
        assert (image == 1).sum() <= RAYS
        assert not train.masks[index][image == -1].any()


def test_half_of_the_images_are_of_rays_and_only_those_show_free_space(shapes):
    indices = np.zeros(2000, int)
    draw = rays_and_outlines(shapes["train"], 0, free_space=True).draw
    felt = draw(np.random.default_rng(0), indices)
    by_rays = (felt == -1).any(axis=(1, 2))
    assert 900 < by_rays.sum() < 1100
    blind = rays_and_outlines(shapes["train"], 0, free_space=False).draw
    np.testing.assert_array_equal(blind(np.random.default_rng(0), indices), felt == 1)


def test_free_space_is_what_the_rays_of_a_sequence_passed(shapes):
    """Each image of rays is that of the first rays of some sequence of its shape."""
    train = shapes["train"]
    rays, touches = plain_sequences(train, np.random.default_rng(5))
    assert rays.shape == touches.shape == (len(train), 3 * SEQUENCES, RAYS, 2)
    possible = set()
    for some, ends in zip(rays[3], touches[3], strict=True):
        np.testing.assert_array_equal(cast_rays(train.masks[[3]], some, np.zeros(RAYS, int)), ends)
        felt = np.zeros((1, 64, 64), np.int8)
        free = np.zeros((1, 64, 64), np.uint8)
        for ray, end in zip(some, ends, strict=True):
            mark_free(free, ray[None], end[None])
            if end[0] >= 0:
                felt[0, end[0], end[1]] = 1
            possible.add((felt - free.astype(np.int8)).tobytes())
    drawn = rays_and_outlines(train, 5, free_space=True).draw(
        np.random.default_rng(0), np.full(50, 3)
    )
    by_rays = [image.tobytes() for image in drawn if (image == -1).any()]
    assert len(by_rays) > 10
    assert set(by_rays) <= possible
