"""Roll-outs as the report draws them, the animation, and sheets of shapes."""

import dataclasses
import io

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.colors import to_hex, to_rgb
from matplotlib.text import Text
from PIL import Image, ImageSequence
from scipy.ndimage import gaussian_filter, label

from tactile_core.dataset.outlines import outline
from tactile_core.dataset.rendering.pictures import encode_mask
from tactile_core.evaluation.replay import Rollout
from tactile_core.exploration.world.rays import candidate_rays, cast_rays, ray_ends
from tactile_core.figures.animation import rollout_gif
from tactile_core.figures.rollouts import runs_figure, steps_figure
from tactile_core.figures.scene import PANEL, SIDE
from tactile_core.figures.sheets import crop, mask_sheet, reconstruction_sheet, tile, touch_sheet
from tactile_core.figures.style import MUTED, PINK, RAY, SHAPE, TINT, YELLOW, blend, png

R = 64


def as_pictures(masks: np.ndarray) -> pd.Series:
    return pd.Series(map(encode_mask, masks))


def bottle() -> np.ndarray:
    """A (R, R) mask: a body with a neck."""
    mask = np.zeros((R, R), bool)
    mask[26:42, 18:36] = mask[31:37, 36:46] = True
    return mask


def rollout(rays: int = 10) -> Rollout:
    """Every third ray passes the bottle by; the prediction sharpens from ray to ray."""
    mask = bottle()
    grid = candidate_rays(R)
    chosen = np.array([grid[(4 * ray) % 36, 0 if ray % 3 == 2 else 5] for ray in range(rays)])
    touches = cast_rays(np.repeat(mask[None], rays, axis=0), chosen)
    predictions = [gaussian_filter(mask.astype(np.float32), 9 / (1 + ray)) for ray in range(rays)]
    jaccard = 100 * np.array(
        [((p > 0.5) & mask).sum() / ((p > 0.5) | mask).sum() for p in predictions]
    )
    return Rollout("even", mask, ray_ends(chosen, R), touches, np.array(predictions), jaccard)


def colours(image: Image.Image) -> np.ndarray:
    return np.asarray(image.convert("RGB")).astype(int)


def near(image: np.ndarray, colour: str, within: int = 12) -> np.ndarray:
    """Where an (h, w, 3) image has about this colour."""
    wanted = np.array([round(255 * part) for part in to_rgb(colour)])
    return (np.abs(image - wanted) <= within).all(axis=-1)


def test_figure_2_has_a_panel_for_every_ray_and_says_which_missed() -> None:
    run = rollout()
    titles = [axes.get_title() for axes in steps_figure(run).axes if axes.get_title()]
    assert len(titles) == 10
    missed = [f"ray {ray + 1}" for ray in np.flatnonzero(run.touches[:, 0] < 0)]
    assert missed == ["ray 3", "ray 6", "ray 9"]
    assert [title.split(":")[0] for title in titles if "missed" in title] == missed


@pytest.mark.parametrize("draw", [steps_figure, lambda run: runs_figure([run])])
def test_figures_2_and_3_name_policy_class_and_signs_in_upright_words(draw) -> None:
    figure = draw(dataclasses.replace(rollout(), category="mug"))
    figure.draw_without_rendering()
    words = [text for text in figure.findobj(Text) if text.get_text()]
    assert any("even, mug" in text.get_text() for text in words)
    assert all(text.get_rotation() == 0 for text in words)
    (legend,) = figure.legends
    assert {"object", "reconstruction", "ray", "touch"} < {
        text.get_text() for text in legend.get_texts()
    }


def test_each_panel_of_figure_2_shows_the_touches_held_by_then() -> None:
    run = rollout()
    for step, axes in enumerate(steps_figure(run).axes):
        drawn = np.concatenate([some.get_offsets() for some in axes.collections])
        held = run.touches[: step + 1]
        assert sorted(map(tuple, drawn)) == sorted(map(tuple, held[held[:, 0] >= 0][:, ::-1]))


def test_figure_3_shows_actions_and_observation_of_every_policy() -> None:
    figure = runs_figure([rollout(), rollout(3)])
    left, right = figure.axes[:2]
    run = rollout()
    shown = left.images[0].get_array()
    predicted = run.predictions[-1] > 0.5
    assert len(np.unique(shown[predicted & run.mask], axis=0)) == 1
    assert (shown[~predicted & ~run.mask] == 1).all()
    probability = right.images[0].get_array()[..., 0]
    order = np.argsort(run.predictions[-1], axis=None)
    assert (np.diff(probability.ravel()[order]) >= -1e-6).all(), "more pink, more probable"
    assert len(figure.axes) == 4


def test_the_animation_is_small_endless_and_repeats_to_the_byte() -> None:
    data = rollout_gif(rollout())
    image = Image.open(io.BytesIO(data))
    assert len(data) < 300_000
    assert image.size == (SIDE + PANEL, SIDE)
    assert image.info["loop"] == 0
    assert data == rollout_gif(rollout())


def test_the_animation_lasts_some_seconds_and_ends_on_every_touch_and_the_prediction() -> None:
    run = rollout()
    image = Image.open(io.BytesIO(rollout_gif(run)))
    frames = [(colours(frame), frame.info["duration"]) for frame in ImageSequence.Iterator(image)]
    assert 5_000 < sum(duration for _, duration in frames) < 15_000
    scene = frames[-1][0][:, :SIDE]
    scale = SIDE / R
    yellow, pink = near(scene, YELLOW, 40), near(scene, to_hex(blend(SHAPE, PINK, TINT)), 40)
    for row, column in run.touches[run.touches[:, 0] >= 0]:
        assert yellow[int((row + 0.5) * scale), int((column + 0.5) * scale)]
    sure = np.kron(run.predictions[-1] > 0.95, np.ones((int(scale), int(scale)), bool))
    assert (pink | yellow)[sure].mean() > 0.8
    assert not pink[~np.kron(run.predictions[-1] > 0.2, np.ones((5, 5), bool))].any()


@pytest.mark.parametrize("first", [0, 1, 3])
def test_the_animation_begins_with_the_first_touch(first: int) -> None:
    run = rollout()
    run.touches[:first] = -1
    run.touches[first] = (41, 20)
    begun = colours(Image.open(io.BytesIO(rollout_gif(run))))[:, :SIDE]
    dots, count = label(near(begun, YELLOW, 40))
    assert count == 1
    row, column = np.argwhere(dots).mean(axis=0) * R / SIDE - 0.5
    assert (round(row), round(column)) == (41, 20)
    assert near(begun, RAY, 40).any()


def test_a_rollout_without_a_touch_is_an_animation_too() -> None:
    run = rollout()
    run.touches[:] = -1
    begun = colours(Image.open(io.BytesIO(rollout_gif(run))))[:, :SIDE]
    assert not near(begun, YELLOW, 40).any()


def test_the_animation_is_light_and_has_a_legend_of_every_sign() -> None:
    first = colours(Image.open(io.BytesIO(rollout_gif(rollout()))))
    assert (first > 240).all(axis=-1).mean() > 0.6
    beside = first[:, SIDE:]
    for sign in (SHAPE, to_hex(blend("white", PINK, TINT)), RAY, YELLOW, MUTED):
        assert near(beside, sign, 30).sum() > 20, sign


@settings(max_examples=30, deadline=None)
@given(
    count=st.integers(1, 20),
    columns=st.integers(1, 8),
    quarter=st.sampled_from([8, 12, 16, 32]),
    data=st.data(),
)
def test_tiles_keep_every_pixel_that_a_shape_can_reach_where_the_corners_say(
    count: int, columns: int, quarter: int, data: st.DataObject
) -> None:
    resolution = 4 * quarter
    images = np.zeros((count, resolution, resolution, 3))
    inner = st.integers(quarter, 3 * quarter - 1)
    points = [data.draw(st.tuples(inner, inner)) for _ in range(count)]
    for number, (row, column) in enumerate(points):
        images[number, row, column] = (number + 1) / 50
    tiled, corners = tile(images, columns)
    for number, (point, corner) in enumerate(zip(points, corners, strict=True)):
        assert tiled[tuple(point + corner)].tolist() == [(number + 1) / 50] * 3


def test_a_sheet_shows_every_category_and_no_more_of_each_than_asked() -> None:
    masks = np.repeat(bottle()[None], 50, axis=0)
    figure = mask_sheet(as_pictures(masks), np.array(["mug"] * 10 + ["bottle"] * 40), each=24)
    assert [axes.get_title(loc="left") for axes in figure.axes] == ["bottle  (24 of 40)", "mug"]
    heights = [axes.images[0].get_array().shape[0] for axes in figure.axes]
    assert [round(height / crop(masks).shape[1]) for height in heights] == [2, 1]
    assert len(png(figure)) < 60_000


def test_touches_stand_on_the_outlines_of_their_sheet() -> None:
    masks = np.stack([bottle(), np.rot90(bottle())])
    outlines = [outline(mask) for mask in masks]
    cells = [np.array([None, None], object) for _ in masks]  # as pandas reads lists of points
    for cell, points in zip(cells, outlines, strict=True):
        cell[:] = list(points[[0, 20]])
    figure = touch_sheet(as_pictures(masks), outlines, cells, np.array(["bottle", "bottle"]))
    (axes,) = figure.axes
    image = axes.images[0].get_array()
    dots = np.concatenate([some.get_offsets() for some in axes.collections]).astype(int)
    outline_colour = image[tuple(dots[0, ::-1])]
    assert len(dots) == 4
    assert (image[tuple(dots.T[::-1])] == outline_colour).all()
    assert 0 < (image == outline_colour).all(axis=-1).mean() < 0.2


@pytest.mark.parametrize("count", [1, 40])
def test_reconstructions_go_from_good_to_bad(count: int) -> None:
    masks = np.repeat(bottle()[None], count, axis=0)
    jaccard = np.random.default_rng(0).permutation(np.linspace(40, 95, count))
    touches = [outline(bottle())[: 1 + number % 10] for number in range(count)]
    figure = reconstruction_sheet(touches, masks.astype(np.float32), masks, jaccard)
    titles = [axes.get_title() for axes in figure.axes if axes.get_title()]
    shown = [int(title.split("Jaccard ")[1].split(",")[0]) for title in titles]
    assert [title.split(":")[0] for title in titles] == 2 * ["good"] + 2 * ["median"] + 2 * ["bad"]
    assert shown == sorted(shown, reverse=True)
