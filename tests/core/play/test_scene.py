"""The pictures: a sign for each thing felt, and the shape only when it is told."""

import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactile_core.exploration.world.rays import candidate_rays
from tactile_core.play.aim import Aim
from tactile_core.play.drawing import Drawing
from tactile_core.play.game import Hand
from tactile_core.play.scene import aim_svg, drawing_svg, frame, hand_svg, place_at

share = st.floats(0, 1)


def signs(svg: str, kind: str) -> list[ElementTree.Element]:
    return [part for part in ElementTree.fromstring(svg).iter() if part.get("class") == kind]


@pytest.fixture
def hand(shapes, reconstructor) -> Hand:
    hand = Hand(shapes["test"].masks[0], reconstructor)
    for alpha, beta in [*candidate_rays(64)[::6, 5], (0, 1)]:
        hand.cast((int(alpha), int(beta)))
    return hand


def test_every_touch_and_every_miss_has_a_sign(hand):
    svg = hand_svg(hand.steps, hand.reconstruction(len(hand.steps)))
    touched = [step for step in hand.steps if step.touch]
    assert 0 < len(touched) < len(hand.steps)
    assert len(signs(svg, "touch")) == len(signs(svg, "ray")) == len(touched)
    assert len(signs(svg, "miss")) == len(hand.steps) - len(touched)
    rows = {float(sign.get("cy", 0)) - 0.5 for sign in signs(svg, "touch")}
    assert rows == {step.touch[0] for step in touched}


def test_the_shape_is_in_the_picture_only_when_it_is_told(hand, shapes):
    before = hand_svg(hand.steps, hand.reconstruction(2))
    assert not signs(before, "truth") and signs(before, "uncertain")
    told = hand_svg(hand.steps, hand.reconstruction(2), shapes["test"].masks[0])
    assert len(signs(told, "truth")) == 2


def test_before_the_first_ray_there_is_a_picture_already(hand):
    svg = hand_svg([], hand.untouched)
    assert not signs(svg, "touch") and not signs(svg, "ray") and not signs(svg, "miss")


def test_what_is_aimed_at_is_drawn_from_its_start(hand):
    aim = Aim(64)
    assert not signs(aim_svg(aim), "start")
    aim.move((0.0, 31.0))
    assert signs(aim_svg(aim), "start") and not signs(aim_svg(aim), "aim")
    aim.key("ArrowLeft", False)
    assert signs(aim_svg(aim), "start") and signs(aim_svg(aim), "aim")


@given(down=share, right=share)
def test_a_pointer_is_where_the_picture_shows_it(down, right):
    corner, side = frame(64)
    row, column = place_at((down, right), 64)
    np.testing.assert_allclose([row + 0.5 - corner, column + 0.5 - corner],
                               [down * side, right * side], atol=1e-9)  # fmt: skip


def test_a_drawing_under_way_is_a_picture():
    drawing = Drawing(64)
    ElementTree.fromstring(drawing_svg(drawing))
    drawing.press((20.0, 20.0))
    for place in [(20.0, 40.0), (40.0, 40.0), (40.0, 20.0)]:
        drawing.move(place)
    assert len(list(ElementTree.fromstring(drawing_svg(drawing)).iter())) > 4
