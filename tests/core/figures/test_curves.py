"""Figures 4 and 5, training curves, and the bytes they become."""

import io
import itertools
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from PIL import Image

from tactile_core.figures.curves import (
    learning_curve,
    policy_curves,
    search_scatter,
    touches_curve,
    training_curves,
)
from tactile_core.figures.style import OURS, POLICY_LINES, png, policy_lines

POLICIES = ["random", "even", "diff", "total", "ours", "oracle"]


def curve(policies: list[str], index: str = "step") -> pd.DataFrame:
    """Lines that all end within two points of 80."""
    positions = np.arange(1, 11)
    return pd.concat(
        pd.DataFrame(
            {
                "policy": policy,
                index: positions,
                "mean": 50 + 3.0 * positions + 0.3 * number,
                "low": 49 + 3.0 * positions,
                "high": 51 + 3.0 * positions,
            }
        )
        for number, policy in enumerate(policies)
    )


def colours_of_names(figure: Figure) -> dict[str, str]:
    """The colour in which each policy's name stands beside its line."""
    names = {}
    for text in figure.axes[0].texts:
        words = text.get_text().split()
        if words[0] in POLICIES:
            names[words[0]] = to_hex(text.get_color())
    return names


def test_a_policy_has_one_colour_in_all_figures() -> None:
    colours = colours_of_names(policy_curves(curve(POLICIES)))
    assert colours.keys() == set(POLICIES)
    assert colours == colours_of_names(policy_curves(curve(POLICIES, "grasp"), "grasp"))
    some = colours_of_names(policy_curves(curve(["total", "random"])))
    assert some == {name: colours[name] for name in some}
    trained = [policy_lines(POLICIES)[name].colour for name in ("diff", "total", "ours")]
    assert len(set(trained)) == 3


def test_lines_are_told_apart_without_colour() -> None:
    known = [line for lines in POLICY_LINES.values() for line in lines.values()]
    for lines in (known, OURS):
        looks = {(line.marker, line.dashes, line.filled) for line in lines}
        assert len(looks) == len(lines)
    assert not {line.marker for line in OURS} & {line.marker for line in known}


def test_the_legend_groups_rules_the_report_s_policies_and_ours() -> None:
    (legend,) = policy_curves(curve([*POLICIES, "more of ours"])).legends
    names = [text.get_text() for text in legend.get_texts()]
    assert len(names) == 4 * 3
    columns = [names[start : start + 3] for start in (0, 3, 6, 9)]
    assert columns == [
        ["rules", "random", "even"],
        ["the report's", "diff", "total"],
        ["ours", "more of ours", "ours"],
        ["know more", "oracle", ""],
    ]


def test_a_line_runs_through_the_means_inside_its_band() -> None:
    axes = policy_curves(curve(["even"])).axes[0]
    assert axes.lines[0].get_ydata().tolist() == (50 + 3.0 * np.arange(1, 11)).tolist()
    band = axes.collections[0].get_paths()[0].get_extents()
    assert (band.ymin, band.ymax) == (52, 81)


def test_names_beside_lines_that_end_together_do_not_overlap() -> None:
    figure = policy_curves(curve(POLICIES))
    figure.draw_without_rendering()
    texts = [text for text in figure.axes[0].texts if text.get_text().split()[0] in POLICIES]
    boxes = sorted((text.get_window_extent() for text in texts), key=lambda box: box.y0)
    for lower, upper in itertools.pairwise(boxes):
        assert lower.y0 + 0.8 * lower.height <= upper.y0


def test_png_is_as_wide_as_asked_small_and_carries_no_metadata() -> None:
    data = png(policy_curves(curve(POLICIES)), width_px=640)
    image = Image.open(io.BytesIO(data))
    assert image.width == 640
    assert image.info == {}
    assert len(data) < 60_000


def test_equal_tables_give_equal_bytes() -> None:
    assert png(policy_curves(curve(POLICIES))) == png(policy_curves(curve(POLICIES)))


def test_figures_leave_pyplot_alone() -> None:
    """pyplot keeps figures alive and picks a display: a long run must not meet it."""
    program = (
        "import sys; from tactile_core.figures import animation, curves, rollouts, sheets, style; "
        "style.png(__import__('matplotlib.figure').figure.Figure()); "
        "sys.exit('matplotlib.pyplot' in sys.modules)"
    )
    subprocess.run([sys.executable, "-c", program], check=True)


def test_the_learning_curve_marks_the_epoch_that_is_kept() -> None:
    table = pd.DataFrame(
        {
            "epoch": [1, 2, 3],
            "train_loss": [0.3, 0.2, 0.1],
            "eval_loss": [0.3, 0.2, 0.25],
            "eval_jaccard": [60.0, 71.5, 72.0],
        }
    )
    texts = [text.get_text() for axes in learning_curve(table).axes for text in axes.texts]
    assert texts == ["kept: epoch 2, 71.5"]


def test_touches_curve_shows_every_split_and_its_mix_of_touches() -> None:
    rows = [
        (split, touches, 53.0 if touches is None else 50.0 + touches)
        for split in ("train", "eval", "test")
        for touches in (None, 0, 1, 2)
    ]
    table = pd.DataFrame(rows, columns=["split", "touches", "jaccard"]).astype({"touches": "Int64"})
    lines = touches_curve(table).axes[0].lines
    assert [list(line.get_ydata()) for line in lines] == 3 * [[50, 51, 52], [53, 53]]


def test_every_training_seed_has_its_own_line_and_every_approach_its_own_rewards() -> None:
    table = pd.DataFrame(
        [
            (approach, seed, steps, steps + seed, 60.0 + seed)
            for approach in ("total", "diff")
            for seed in (0, 1, 2)
            for steps in (100, 200)
        ],
        columns=["approach", "seed", "steps", "reward", "jaccard"],
    )
    jaccard, *rewards = training_curves(table).axes
    assert len(jaccard.lines) == 6
    assert [axes.get_title(loc="left") for axes in rewards] == ["reward of diff", "reward of total"]
    assert [len(axes.lines) for axes in rewards] == [3, 3]


@pytest.mark.parametrize("trials", [1, 7])
def test_the_search_shows_every_trial_and_rings_the_best(trials: int) -> None:
    generator = np.random.default_rng(0)
    table = pd.DataFrame(
        {
            "trial": range(trials),
            "learning_rate": 10 ** generator.uniform(-4, -2, trials),
            "batch_size": 16,
            "depth": generator.choice([3, 4], trials),
            "channels": generator.choice([8, 16, 32], trials),
            "epochs": generator.choice([1, 4], trials),
            "loss": generator.uniform(0.03, 0.1, trials),
            "jaccard": 75.0,
        }
    )
    *dots, ring = search_scatter(table).axes[0].collections
    drawn = np.concatenate([some.get_offsets() for some in dots])
    best = table.loc[table["loss"].idxmin(), ["learning_rate", "loss"]].tolist()
    assert len(drawn) == trials
    assert ring.get_offsets().tolist() == [best]
