"""How a policy sees an exploration and names a ray."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_core.errors import TactileError
from tactile_core.exploration.world.interface import Interface
from tactile_core.exploration.world.rays import candidate_rays, cast_rays
from tactile_core.exploration.world.state import Explorations

LAYOUTS = ("alpha and beta", "angle and offset")


@pytest.mark.parametrize("layout", LAYOUTS)
@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 2**31 - 1), resolution=st.sampled_from([48, 64]))
def test_the_ray_of_an_action_is_named_by_an_action_for_that_ray(layout, seed, resolution):
    interface = Interface(layout)
    space = interface.action_space(resolution)
    space.seed(seed)
    rays = interface.rays(np.stack([space.sample() for _ in range(5)]), resolution)
    again = interface.rays(interface.actions_of(rays, resolution), resolution)
    np.testing.assert_array_equal(again, rays)


def test_angle_and_offset_name_the_candidate_rays():
    interface = Interface("angle and offset")
    assert interface.action_space(64).nvec.tolist() == [36, 11]
    named = interface.rays(np.array([[7, 3]]), 64)
    np.testing.assert_array_equal(named[0], candidate_rays(64)[7, 3])


def test_a_ray_that_no_angle_and_offset_name_is_told(shapes):
    with pytest.raises(TactileError, match="no angle and offset name the ray"):
        Interface("angle and offset").actions_of(np.array([[5, 5]]), 64)


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("action", [[-1, 0], [0, -1], [1000, 0], [0.5, 1.0], [1, 2, 3]])
def test_an_action_outside_of_the_action_space_is_refused(layout, action):
    with pytest.raises(TactileError, match=layout):
        Interface(layout).rays(np.array([action]), 64)


@pytest.mark.parametrize(
    "wrong",
    [{"actions": "alpha"}, {"channels": ("free",)}, {"channels": ("ray number", "ray number")}],
)
def test_unknown_layouts_and_channels_are_refused(wrong):
    with pytest.raises(TactileError, match="choose"):
        Interface(**wrong)


def test_further_channels_show_free_space_and_the_number_of_rays(shapes, reconstructor):
    masks = shapes["train"].masks[:2]
    explorations = Explorations(masks, reconstructor)
    interface = Interface(channels=("ray number", "free space"))
    rays = candidate_rays(64).reshape(-1, 2)[[5, 200]]
    explorations.cast(rays)
    seen = interface.observe(explorations)
    assert interface.observation_space(64).shape == seen.shape[1:] == (4, 64, 64)
    np.testing.assert_array_equal(seen[:, :2], explorations.observations())
    assert (seen[:, 2] == 25).all()
    for image, touch in zip(seen[:, 3], cast_rays(masks, rays), strict=True):
        assert set(np.unique(image)) == {0, 255}
        assert image[tuple(touch)] == 0
    for _ in range(11):
        explorations.cast(rays)
    assert (interface.observe(explorations, np.array([1]))[0, 2] == 255).all()
