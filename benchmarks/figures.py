"""Cost against size, and how far two precisions lie apart, as figures."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from benchmarks.precision import roughs
from benchmarks.timing import Curve
from tactile_core.figures.style import FAINT, INK, MUTED, PINK, RAY, plot

LINES = {True: "o-", False: "s--"}  # of the first resolution, of another


def cost_figure(curves: Sequence[Curve]) -> Figure:
    """Each curve on log–log axes, its slope in the note; below, what a step or mesh costs."""
    figure = Figure(figsize=(9, 7), layout="constrained")
    for axes, curve in zip(figure.subplots(2, 2).flat, curves, strict=True):
        note = (
            f"cost grows as {curve.size} to the power {curve.slope():.2f}, "
            f"{curve.last_slope():.2f} at the end"
        )
        plot(axes, sentence(curve.what), curve.size, curve.unit, note)
        axes.loglog(curve.sizes, curve.values, "o-", color=RAY, ms=4, lw=1.6)
        axes.set_xticks(curve.sizes, [short(size) for size in curve.sizes])
        axes.minorticks_off()
        low, high = min(curve.values), max(curve.values)
        ticks = [value for value in round_numbers() if low / 1.5 <= value <= high * 1.5]
        axes.set_yticks(ticks, [short(value) for value in ticks])
        axes.set_ylim(low / 1.6, high * 1.6)
    return figure


def precision_figure(pairs: pd.DataFrame) -> Figure:
    """How many touch images change their Jaccard index by how much, in each precision."""
    precisions = roughs(pairs)
    figure = Figure(figsize=(8, 3.6 * len(precisions)), layout="constrained")
    edges = np.arange(-2.1, 2.2, 0.2)
    for precision, axes in zip(
        precisions, figure.subplots(len(precisions), 1, squeeze=False).flat, strict=True
    ):
        plot(
            axes, f"What {precision} changes", f"Jaccard index, {precision} − float32",
            "share of touch images", "every bar is a fifth of a point wide",
        )  # fmt: skip
        for colour, (name, some) in zip((RAY, PINK), pairs.groupby("touches"), strict=True):
            gaps = (some[precision] - some["float32"]).clip(-2, 2)
            axes.stairs(
                np.histogram(gaps, edges)[0] / len(gaps), edges, color=colour, lw=1.6,
                label=f"{name}:\n{len(gaps)} pairs, mean {gaps.mean():+.3f}",
            )  # fmt: skip
        axes.axvline(0, color=FAINT, lw=0.8, zorder=0)
        axes.legend(frameon=False, fontsize=9, labelcolor=INK, loc="upper right")
        axes.text(
            1, 1.03, "beyond 2 points: counted in the last bars", transform=axes.transAxes,
            fontsize=8.5, color=MUTED, ha="right",
        )  # fmt: skip
    return figure


def sentence(words: str) -> str:
    return words[0].upper() + words[1:]


def short(number: float) -> str:
    """1500 as 1.5k."""
    return f"{number / 1000:.3g}k" if number >= 1000 else f"{number:.3g}"


def round_numbers() -> list[float]:
    return [step * 10.0**power for power in range(-2, 8) for step in (1, 2, 5)]


def size_figure(sizes: pd.DataFrame) -> Figure:
    """Peak memory and time of each stage against the number of models, on log–log axes."""
    figure = Figure(figsize=(9, 4.6), layout="constrained")
    panels = {"peak_mb": ("Peak memory", "MB"), "processor_seconds": ("Time", "processor seconds")}
    stages, resolutions = sizes["stage"].unique(), sizes["resolution"].unique()
    models = sorted(sizes["models"].unique())
    for axes, (column, (title, unit)) in zip(figure.subplots(1, 2), panels.items(), strict=True):
        plot(axes, title, "models", unit, "")
        for (resolution, stage), rows in sizes.groupby(["resolution", "stage"], sort=False):
            rows = rows.sort_values("models")
            axes.loglog(
                rows["models"], rows[column], LINES[resolution == resolutions[0]], ms=4, lw=1.4,
                color=f"C{list(stages).index(stage)}",
            )  # fmt: skip
        low, high = sizes[column].min(), sizes[column].max()
        ticks = [value for value in round_numbers() if low / 1.2 <= value <= high * 1.2]
        axes.set_yticks(ticks, [short(value) for value in ticks])
        axes.set_xticks(models, [short(count) for count in models], rotation=45)
        axes.minorticks_off()
    keys = [
        *(Line2D([], [], color=f"C{number}", label=stage) for number, stage in enumerate(stages)),
        *(
            Line2D([], [], color=INK, ls=LINES[size == resolutions[0]][1:], label=f"{size}×{size}")
            for size in resolutions
        ),
    ]
    figure.legend(handles=keys, loc="outside lower center", ncols=4, frameon=False, labelcolor=INK)
    return figure
