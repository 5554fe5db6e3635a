"""Shapes to hide, wherever they are from, are masks that the game can be played on."""

import numpy as np
import pytest
from scipy import ndimage

from tactile_core.dataset.procedural.models import GENERATORS, obj_bytes
from tactile_core.dataset.seeds import generator
from tactile_core.errors import TactileError
from tactile_core.play.drawing import MOST_PLACES, Drawing
from tactile_core.play.hidden import brought, drawn, hiding_places


def ring(drawing: Drawing, radius: float) -> None:
    angles = np.linspace(0, 2 * np.pi, 60)
    first, *others = np.stack([25 + radius * np.sin(angles), 40 + radius * np.cos(angles)], 1)
    drawing.press(tuple(first))
    for place in others:
        drawing.move(tuple(place))
    drawing.release()


def in_the_middle_half(mask: np.ndarray) -> bool:
    quarter = len(mask) // 4
    outside = mask.copy()
    outside[quarter:-quarter, quarter:-quarter] = False
    return mask.any() and not outside.any()


def test_every_choice_makes_a_shape_and_says_which(shapes):
    test = shapes["test"]
    stored = {name: test.masks[test.categories == name] for name in np.unique(test.categories)}
    makers = hiding_places(stored, 64)
    assert {"any of the test split", "mug of the test split", "newly generated mug"} <= set(makers)
    for name, make in makers.items():
        one, same, other = (make(np.random.default_rng(seed)) for seed in (1, 1, 2))
        assert in_the_middle_half(one.mask)
        assert one.said
        np.testing.assert_array_equal(one.mask, same.mask)
        assert "generated" not in name or not np.array_equal(one.mask, other.mask)


def test_what_is_drawn_is_centred_and_a_loop_within_is_a_hole():
    drawing = Drawing(64)
    ring(drawing, 10)
    whole = drawn(drawing, 64).mask
    ring(drawing, 5)
    hollow = drawn(drawing, 64).mask
    assert in_the_middle_half(whole)
    assert np.hypot(*(np.array(ndimage.center_of_mass(whole)) - 31.5)) < 1
    assert ndimage.label(~whole)[1] == 1 and ndimage.label(~hollow)[1] == 2


@pytest.mark.parametrize("reach", [0.47, 0.5, 0.6])
def test_a_drawing_that_leads_beyond_the_picture_is_not_turned_inside_out(reach):
    turn = np.linspace(0, 2 * np.pi, 80)
    first, *others = 64 * (0.5 + reach * np.stack([np.sin(turn), np.cos(turn)], axis=1))
    drawing = Drawing(64)
    drawing.press(tuple(first))
    for place in others:
        drawing.move(tuple(place))
    mask = drawn(drawing, 64).mask
    assert mask[32, 32] and 380 < mask.sum() < 560


def test_a_drawing_takes_no_more_places_than_it_can_hold_and_none_while_the_pointer_is_up():
    drawing = Drawing(64)
    drawing.move((1.0, 1.0))
    assert not drawing.loops
    drawing.press((1.0, 1.0))
    for _ in range(MOST_PLACES + 10):
        drawing.move((1.0, 1.0))
    assert len(drawing.loops[0]) == MOST_PLACES


def test_a_drawing_without_a_loop_is_refused():
    drawing = Drawing(64)
    drawing.press((1.0, 1.0))
    drawing.move((1.0, 9.0))
    with pytest.raises(TactileError, match="draw its outline first"):
        drawn(drawing, 64)


def test_a_file_is_told_by_its_name_and_refused_with_it():
    mesh = obj_bytes(GENERATORS["mug"](generator(0, "mine")))
    thing = brought(mesh, "cup.OBJ", 64)
    assert in_the_middle_half(thing.mask) and thing.said == "cup.OBJ"
    for data, name in [(b"v 0 0", "x.obj"), (b"GIF89a", "x.png"), (mesh, "cup.exe"), (b"", "x")]:
        with pytest.raises(TactileError, match=f"^{name} "):
            brought(data, name, 64)
