"""Figures 4 and 5 of the report, and the curves of every training."""

from typing import Any

import numpy as np
import pandas as pd
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, MaxNLocator, NullLocator
from numpy.typing import ArrayLike
from scipy.optimize import isotonic_regression

from tactile_core.figures.style import (
    INK,
    MUTED,
    PINK,
    RAY,
    Line,
    plot,
    policy_groups,
    policy_lines,
)

DEPTH_MARKERS = "osD^vP"  # one for each depth, in rising order


def policy_curves(curve: pd.DataFrame, index: str = "step") -> Figure:
    """Figure 4 ("step") or 5 ("grasp") from `statistics.mean_curve`: a line and band per policy."""
    figure = Figure(figsize=(8, 6.2), layout="constrained")
    title, x, note = {
        "step": ("Mean Jaccard index after each ray", "rays cast", ""),
        "grasp": (
            "Mean Jaccard index after each touch",
            "touches held",
            "; a rollout that runs out of rays keeps its last value",
        ),
    }[index]
    note = "bands: 95 % intervals over models and seeds" + note
    axes = plot(figure.subplots(), title, x, "Jaccard index", note)
    ends = {}
    lines = policy_lines(curve["policy"])
    for policy, line in lines.items():
        rows = curve[curve["policy"] == policy]
        axes.fill_between(
            rows[index], rows["low"], rows["high"], color=line.colour, alpha=0.15, linewidth=0
        )
        axes.add_line(drawn(line, rows[index], rows["mean"]))
        ends[policy] = float(rows["mean"].iloc[-1])
    last = int(curve[index].max())
    axes.set_xlim(1 - 0.15, last + 0.05)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xticks(range(1, last + 1))
    label_ends(axes, last + 0.05, ends, lines)
    name_lines(figure, policy_groups(curve["policy"]))
    return figure


def drawn(line: Line, x: ArrayLike = (), y: ArrayLike = ()) -> Line2D:
    """A policy's line through these points, with its marker at each."""
    return Line2D(
        np.asarray(x), np.asarray(y), color=line.colour, linestyle=line.dashes,
        linewidth=line.width, marker=line.marker, markersize=3 + 1.8 * line.width,
        markerfacecolor=line.colour if line.filled else "white", markeredgewidth=1,
    )  # fmt: skip


def name_lines(figure: Figure, groups: dict[str, dict[str, Line]]) -> None:
    """A legend below the axes, a column for each group of policies under the group's name."""
    nothing = Line2D([], [], linestyle="none")
    rows = max(map(len, groups.values()))
    handles, labels = [], []
    for group, lines in groups.items():
        blank = rows - len(lines)
        handles += [nothing, *map(drawn, lines.values()), *[nothing] * blank]
        labels += [group, *lines, *[""] * blank]
    legend = figure.legend(
        handles, labels, loc="outside lower center", ncols=len(groups), frameon=False, fontsize=9,
        labelcolor=INK, handlelength=4, columnspacing=3,
    )  # fmt: skip
    for text in legend.get_texts()[:: rows + 1]:
        text.set_fontweight("bold")


def label_ends(axes: Axes, x: float, ends: dict[str, float], lines: dict[str, Line]) -> None:
    """Write each policy's name and last value beside its line, apart from its neighbours'."""
    low, high = axes.get_ylim()
    gap = (high - low) / 25
    names = sorted(ends, key=lambda name: ends[name])
    steps = gap * np.arange(len(names))
    # The least moves that keep labels a gap apart: a monotone fit once the gaps are taken off.
    places = isotonic_regression([ends[name] for name in names] - steps).x + steps
    beyond = x + (axes.get_xlim()[1] - axes.get_xlim()[0]) * 0.03
    for name, place in zip(names, places, strict=True):
        colour = lines[name].colour
        axes.plot([x, beyond], [ends[name], place], color=colour, lw=0.8, clip_on=False)
        axes.text(beyond, place, f" {name} {ends[name]:.1f}", color=colour, fontsize=9, va="center")


def learning_curve(curve: pd.DataFrame) -> Figure:
    """The U-Net's training from columns epoch, train_loss, eval_loss, eval_jaccard."""
    figure = Figure(figsize=(8, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    plot(left, "Cross-entropy", "epoch", "loss per pixel")
    left.plot(curve["epoch"], curve["train_loss"], color=RAY, lw=1.6, label="train")
    left.plot(curve["epoch"], curve["eval_loss"], color=PINK, lw=1.6, label="eval")
    left.legend(frameon=False, fontsize=9, labelcolor=INK)
    plot(right, "Jaccard index on the eval split", "epoch", "Jaccard index")
    right.plot(curve["epoch"], curve["eval_jaccard"], color=PINK, lw=1.6)
    kept = curve.loc[curve["eval_loss"].idxmin()]
    left.plot(kept["epoch"], kept["eval_loss"], "o", color=PINK, ms=6)
    right.plot(kept["epoch"], kept["eval_jaccard"], "o", color=PINK, ms=6)
    right.annotate(
        f"kept: epoch {kept['epoch']:.0f}, {kept['eval_jaccard']:.1f}",
        (kept["epoch"], kept["eval_jaccard"]),
        xytext=(-6, -16), textcoords="offset points", ha="right", fontsize=9, color=INK,
    )  # fmt: skip
    for axes in (left, right):
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    return figure


def touches_curve(reconstruction: pd.DataFrame) -> Figure:
    """Jaccard index by number of touches from columns split, touches (null: the mix), jaccard.

    Of several U-Nets it is their mean.
    """
    figure = Figure(figsize=(8, 4), layout="constrained")
    axes = plot(
        figure.subplots(), "Reconstruction by number of touches", "touches", "Jaccard index",
        "dashed: the mix of 1 to 10 touches, as in the report's Table II",
    )  # fmt: skip
    colours = {"train": RAY, "eval": MUTED, "test": PINK}
    for split, colour in colours.items():
        rows = reconstruction[reconstruction["split"] == split]
        numbered = rows[rows["touches"].notna()].groupby("touches")["jaccard"].mean()
        axes.plot(
            numbered.index.astype(int), numbered, "o-", color=colour, ms=4, lw=1.6,
            label=split,
        )  # fmt: skip
        axes.axhline(
            rows.loc[rows["touches"].isna(), "jaccard"].mean(), color=colour, lw=1, ls=(0, (4, 2))
        )
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.legend(frameon=False, fontsize=9, labelcolor=INK, loc="lower right")
    return figure


def training_curves(curves: pd.DataFrame) -> Figure:
    """How trainings went, from columns approach, seed, steps, reward, jaccard: a line per seed.

    Rewards of different approaches cannot be compared, so each has axes of its own.
    """
    lines = policy_lines(curves["approach"])
    figure = Figure(figsize=(8, 4.4), layout="constrained")
    large, small = figure.subfigures(1, 2, width_ratios=(1.5, 1), squeeze=False)[0]
    title = "Jaccard index at the end of an episode"
    jaccard = plot(large.add_subplot(), title, "rays cast in training", "Jaccard index")
    rewards = small.subplots(len(lines), 1, sharex=True, squeeze=False)[:, 0]
    for axes, (approach, line) in zip(rewards, lines.items(), strict=True):
        plot(axes, "", "", "")
        axes.set_title(f"reward of {approach}", loc="left", fontsize=8.5, color=line.colour, pad=3)
        for number, (_, rows) in enumerate(
            curves[curves["approach"] == approach].groupby("seed", sort=True)
        ):
            axes.plot(rows["steps"], rows["reward"], color=line.colour, lw=1.2)
            jaccard.plot(
                rows["steps"], rows["jaccard"], color=line.colour, lw=line.width,
                label=approach if number == 0 else None,
            )  # fmt: skip
    jaccard.legend(frameon=False, fontsize=9, labelcolor=INK)
    rewards[-1].set_xlabel("rays cast in training", fontsize=9.5, color=INK)
    for axes in (jaccard, rewards[-1]):
        axes.xaxis.set_major_formatter(lambda value, _: f"{value / 1000:g}k" if value else "0")
    return figure


def search_scatter(search: pd.DataFrame) -> Figure:
    """Every trial of the U-Net search: eval loss against learning rate; the best one is named."""
    figure = Figure(figsize=(8, 4.2), layout="constrained")
    axes = plot(
        figure.subplots(), "Trials of the U-Net search", "learning rate", "loss on the eval split",
        "larger dots trained for more epochs before HyperBand stopped them",
    )  # fmt: skip
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.xaxis.set_minor_locator(NullLocator())
    channels = sorted(search["channels"].unique())
    shades = colormaps["viridis_r"](np.linspace(0.12, 0.95, len(channels)))
    markers = dict(zip(sorted(search["depth"].unique()), DEPTH_MARKERS, strict=False))
    for shade, channel in zip(shades, channels, strict=True):
        for depth, marker in markers.items():
            rows = search[(search["channels"] == channel) & (search["depth"] == depth)]
            size = 30 + 60 * rows["epochs"] / search["epochs"].max()
            axes.scatter(
                rows["learning_rate"], rows["loss"], s=size, color=shade, marker=marker,
                edgecolor="white", linewidth=0.6,
            )  # fmt: skip
    keys = [
        *(dot("o", shade, f"{n} channels") for shade, n in zip(shades, channels, strict=True)),
        *(dot(marker, MUTED, f"depth {depth}") for depth, marker in markers.items()),
    ]
    best = search.loc[search["loss"].idxmin()]
    axes.scatter(
        best["learning_rate"], best["loss"], s=220, facecolor="none", edgecolor=PINK, linewidth=1.8
    )
    keys.append(
        dot(
            "o",
            "none",
            f"best: batch {best['batch_size']:.0f}\nJaccard {best['jaccard']:.1f}",
            PINK,
        )
    )
    axes.legend(
        handles=keys, frameon=False, fontsize=9, labelcolor=INK, loc="upper left",
        bbox_to_anchor=(1, 1),
    )  # fmt: skip
    return figure


def dot(marker: str, face: Any, label: str, edge: str = "white") -> Line2D:
    """A legend entry that is one marker."""
    return Line2D(
        [], [], ls="", marker=marker, markerfacecolor=face, markeredgecolor=edge, ms=8, label=label
    )
