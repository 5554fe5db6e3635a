"""One look for all figures: colours, axes, and PNG bytes that are small and always the same."""

import io
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from PIL import Image

from tactile_core.evaluation.statistics import FIRST, LAST, ordered

INK = "#22252b"
MUTED = "#7b818a"
FAINT = "#e7e9ec"
SHAPE = "#c6ccd4"
PINK = "#e8388e"  # what the U-Net predicts, as in the report's Figure 3
YELLOW = "#ffd21f"  # touches, likewise
RAY = "#2f6fb3"
NIGHT = "#14161d"  # background of observations


class Line(NamedTuple):
    """How a policy's line is drawn."""

    colour: str
    dashes: str | tuple[float, tuple[float, ...]] = "solid"
    width: float = 1.6


# Okabe and Ito's colours, which colour-blind readers tell apart too, for the trained policies;
# grey and dashes for the reference policies that they stand beside.
POLICY_LINES = {
    "random": Line("#a3a8af", (0, (1, 1.2))),
    "even": Line("#6d737c", (0, (5, 1.6))),
    "sequence": Line("#6d737c", (0, (1, 1))),
    "coverage": Line("#6d737c", (0, (5, 1.4, 1, 1.4))),
    "uncertainty": Line("#a3a8af", (0, (2.5, 1.4))),
    "diff": Line("#0072b2"),
    "total": Line("#d55e00"),
    "total_miss": Line("#009e73"),
    "pre_diff_miss": Line("#cc79a7"),
    "oracle": Line("#22252b", width=1.2),
}
OURS = ("#7b2d8b", "#e69f00", "#56b4e9", "#8c510a", "#66a61e", "#c51b7d")


def policy_lines(policies: Iterable[str]) -> dict[str, Line]:
    """The line of each policy, in the order of all tables; ours are drawn thicker."""
    names = ordered(policies)
    ours = [name for name in names if name not in (*FIRST, *LAST)]
    lines = {name: Line(OURS[i % len(OURS)], width=2.4) for i, name in enumerate(ours)}
    return {name: lines.get(name) or POLICY_LINES[name] for name in names}


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
