"""Figures 2 and 3 of the report: what one policy does, ray by ray, and what it sees."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch

from tactile_core.evaluation.replay import Rollout
from tactile_core.figures.style import (
    FAINT,
    INK,
    MUTED,
    PINK,
    RAY,
    SHAPE,
    TINT,
    YELLOW,
    blend,
    glow,
    picture,
)
from tactile_core.reconstruction.jaccard import THRESHOLD


def steps_figure(rollout: Rollout) -> Figure:
    """Figure 2: every ray of a rollout with the touches held and the prediction after it."""
    columns = 5
    rows = -(-len(rollout.rays) // columns)
    figure = Figure(figsize=(8, 1.85 * rows + 0.7), layout="constrained")
    figure.suptitle(who_and_what(rollout), fontsize=11, fontweight="bold", color=INK)
    for step, axes in enumerate(figure.subplots(rows, columns, squeeze=False).flat):
        picture(axes)
        if step < len(rollout.rays):
            draw_step(axes, rollout, step)
    name_signs(figure, columns=5)
    return figure


def who_and_what(rollout: Rollout) -> str:
    return f"{rollout.policy}, {rollout.category}" if rollout.category else rollout.policy


def name_signs(figure: Figure, columns: int) -> None:
    """The legend of what is drawn over shapes, below all panels."""
    signs = {
        "object": Patch(color=SHAPE),
        "reconstruction": Patch(color=blend("white", PINK, TINT)),
        "ray": Line2D([], [], color=RAY, lw=1.3),
        "touch": Line2D(
            [], [], color=YELLOW, marker="o", ls="none", markeredgecolor=INK, markeredgewidth=0.5
        ),
        "beyond the touch, or missed": Line2D([], [], color=RAY, lw=0.9, ls=(0, (2, 2)), alpha=0.7),
    }
    figure.legend(
        signs.values(), signs, loc="outside lower center", ncols=columns, frameon=False,
        fontsize=8.5, labelcolor=INK,
    )  # fmt: skip


def draw_step(axes: Axes, rollout: Rollout, step: int) -> None:
    """One step: the prediction over the shape, this ray with its touch, earlier touches smaller."""
    draw_prediction(axes, rollout.mask, rollout.predictions[step])
    draw_ray(axes, rollout.rays[step], rollout.touches[step], width=1.3)
    draw_touches(axes, rollout.touches[:step], size=14)
    draw_touches(axes, rollout.touches[step : step + 1], size=40)
    missed = rollout.touches[step, 0] < 0
    word = "missed," if missed else "Jaccard"
    title = f"ray {step + 1}: {word} {rollout.jaccard[step]:.0f}"
    axes.set_title(title, fontsize=9, color=MUTED if missed else INK, pad=3)


def runs_figure(rollouts: Sequence[Rollout]) -> Figure:
    """Figure 3, a row per rollout: left its rays, touches and prediction, right its observation."""
    figure = Figure(figsize=(5.4, 2.9 * len(rollouts) + 0.6), layout="constrained")
    for rollout, (left, right) in zip(
        rollouts, figure.subplots(len(rollouts), 2, squeeze=False), strict=True
    ):
        hits = int((rollout.touches[:, 0] >= 0).sum())
        score = f"Jaccard {rollout.jaccard[-1]:.0f}, {hits} of {len(rollout.rays)} rays touch"
        picture(left).set_title(
            f"{who_and_what(rollout)}\n{score}", loc="left", fontsize=9.5, color=INK
        )
        picture(right).set_title("what it sees", loc="left", fontsize=9.5, color=MUTED)
        draw_prediction(left, rollout.mask, rollout.predictions[-1])
        for ray, touch in zip(rollout.rays, rollout.touches, strict=True):
            draw_ray(left, ray, touch, width=1)
        draw_touches(left, rollout.touches, size=26)
        draw_observation(right, rollout)
    name_signs(figure, columns=3)
    return figure


def draw_prediction(axes: Axes, mask: np.ndarray, prediction: np.ndarray) -> None:
    """The shape in grey and, in pink over it, where the prediction exceeds the threshold."""
    image = np.ones((*mask.shape, 3))
    image[mask] = to_rgb(SHAPE)
    predicted = prediction > THRESHOLD
    image[predicted] = (1 - TINT) * image[predicted] + TINT * np.array(to_rgb(PINK))
    axes.imshow(image, interpolation="nearest")
    middle = len(mask) / 2 - 1
    axes.add_patch(Circle((middle, middle), middle, fill=False, edgecolor=FAINT, linewidth=1))


def draw_ray(axes: Axes, ray: np.ndarray, touch: np.ndarray, width: float) -> None:
    """A ray from its start (a dot) to its touch and, faint, beyond; all faint where it misses."""
    alpha, beta = ray[:2], ray[2:]
    missed = touch[0] < 0
    reached = alpha if missed else touch
    axes.plot(*segment(alpha, reached), color=RAY, lw=width, solid_capstyle="round")
    axes.plot(*segment(reached, beta), color=RAY, lw=0.7 * width, ls=(0, (2, 2)), alpha=0.55)
    axes.plot(alpha[1], alpha[0], "o", color=RAY, ms=3.2 * width, mew=0, clip_on=False)


def segment(start: np.ndarray, end: np.ndarray) -> tuple[list[int], list[int]]:
    """Two (row, column) points as matplotlib's x and y."""
    return [int(start[1]), int(end[1])], [int(start[0]), int(end[0])]


def draw_touches(axes: Axes, touches: np.ndarray, size: float) -> None:
    """(k, 2) touches as yellow dots, misses left out."""
    rows, columns = touches[touches[:, 0] >= 0].T
    axes.scatter(columns, rows, s=size, color=YELLOW, edgecolor=INK, linewidth=0.5, zorder=3)


def draw_observation(axes: Axes, rollout: Rollout) -> None:
    """What the policy sees at the end: probability in pink, touches in yellow, on a dark ground."""
    axes.imshow(glow(rollout.predictions[-1], PINK), interpolation="nearest")
    rows, columns = rollout.touches[rollout.touches[:, 0] >= 0].T
    axes.scatter(columns, rows, s=14, color=YELLOW, linewidth=0)
