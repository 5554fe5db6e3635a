"""One look for all figures: colours, axes, and PNG bytes that are small and always the same."""

import io
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.typing import LineStyleType
from PIL import Image

from tactile_core.evaluation.statistics import ordered

INK = "#22252b"
MUTED = "#7b818a"
FAINT = "#e7e9ec"
SHAPE = "#c6ccd4"
PINK = "#e8388e"  # what the U-Net predicts, as in the report's Figure 3
YELLOW = "#ffd21f"  # touches, likewise
RAY = "#2f6fb3"
NIGHT = "#14161d"  # background of observations
TINT = 0.58  # how much of the pink covers what is predicted


class Line(NamedTuple):
    """How a policy's line is drawn: told from its neighbours by marker and dashes alone, too."""

    colour: str
    marker: str
    dashes: LineStyleType = "solid"
    width: float = 1.6
    filled: bool = True


# Rules are grey, dashed and hollow, the report's policies thin and filled, ours thick, and those
# that know more than what was felt black. Colours are Okabe and Ito's, which colour-blind readers
# tell apart.
RULES, REPORTS, OUR_OWN, KNOWING = "rules", "the report's", "ours", "know more"
POLICY_LINES = {
    RULES: {
        "random": Line("#8d939b", "o", (0, (1, 1.2)), filled=False),
        "even": Line("#6d737c", "s", (0, (5, 1.6)), filled=False),
        "sequence": Line("#6d737c", "v", (0, (2.5, 1.4)), filled=False),
        "coverage": Line("#6d737c", "^", (0, (5, 1.4, 1, 1.4)), filled=False),
        "uncertainty": Line("#8d939b", "D", (0, (3, 1.2, 1, 1.2, 1, 1.2)), filled=False),
    },
    REPORTS: {
        "diff": Line("#0072b2", "o"),
        "total": Line("#d55e00", "s"),
        "total_miss": Line("#009e73", "^"),
        "pre_diff_miss": Line("#cc79a7", "D"),
    },
    KNOWING: {
        "observer": Line(INK, "1", (0, (4, 2)), width=1.2),
        "observer_ahead": Line(INK, "2", (0, (1, 1.5)), width=1.2),
        "oracle": Line(INK, "x", width=1.2),
    },
}
OURS = (
    Line("#7b2d8b", "P", width=2.4),
    Line("#e69f00", "*", width=2.4),
    Line("#56b4e9", "X", width=2.4),
    Line("#8c510a", "p", width=2.4),
    Line("#66a61e", "h", width=2.4),
    Line("#c51b7d", "d", width=2.4),
)


def policy_groups(policies: Iterable[str]) -> dict[str, dict[str, Line]]:
    """Group → policy → its line, in the order of all tables."""
    groups: dict[str, dict[str, Line]] = {RULES: {}, REPORTS: {}, OUR_OWN: {}, KNOWING: {}}
    for name in ordered(policies):
        for group, lines in POLICY_LINES.items():
            if name in lines:
                groups[group][name] = lines[name]
                break
        else:
            groups[OUR_OWN][name] = OURS[len(groups[OUR_OWN]) % len(OURS)]
    return {group: lines for group, lines in groups.items() if lines}


def policy_lines(policies: Iterable[str]) -> dict[str, Line]:
    """The line of each policy, in the order of all tables."""
    return {
        name: line for group in policy_groups(policies).values() for name, line in group.items()
    }


def plot(axes: Axes, title: str, x: str, y: str, note: str = "") -> Axes:
    """Dress axes for curves: title on the left, a muted note under it, faint grid, no box."""
    axes.set_title(
        title, loc="left", fontsize=11, fontweight="bold", color=INK, pad=22 if note else 8
    )
    if note:
        axes.text(0, 1.03, note, transform=axes.transAxes, fontsize=8.5, color=MUTED)
    axes.set_xlabel(x, fontsize=9.5, color=INK)
    axes.set_ylabel(y, fontsize=9.5, color=INK)
    axes.tick_params(labelsize=9, colors=INK, length=0)
    axes.grid(color=FAINT, linewidth=0.8)
    axes.set_axisbelow(True)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.spines["bottom"].set_color(MUTED)
    return axes


def picture(axes: Axes, title: str = "", colour: str = INK) -> Axes:
    """Dress axes for an image: no ticks, no box."""
    axes.set_axis_off()
    if title:
        axes.set_title(title, fontsize=9.5, color=colour, pad=4)
    return axes


def blend(ground: str, colour: str, amount: float) -> tuple[float, float, float]:
    """So much of a colour over another, as (red, green, blue), 0 to 1."""
    under = np.array(to_rgb(ground))
    red, green, blue = under + amount * (np.array(to_rgb(colour)) - under)
    return red, green, blue


def glow(amount: np.ndarray, colour: str) -> np.ndarray:
    """An (R, R) amount, 0 to 1, of a colour on the dark ground, as an (R, R, 3) image."""
    dark, bright = np.array(to_rgb(NIGHT)), np.array(to_rgb(colour))
    return dark + amount[..., None] * (bright - dark)


def png(figure: Figure, width_px: int = 800) -> bytes:
    """The figure as PNG bytes, `width_px` wide, in 256 colours and without metadata."""
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=width_px / figure.get_figwidth())
    image = Image.open(file).convert("RGB")
    small = io.BytesIO()
    image.quantize(256, dither=Image.Dither.NONE).save(small, format="PNG", optimize=True)
    return small.getvalue()
