"""The pictures of the concepts and of the first screen: `python docs/pictures.py`.

They go to docs/assets: a generated mug, felt out with the U-Net and the policies that are at hand,
and the published curves of the study.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from tactile_core.dataset.things import generated_thing
from tactile_core.evaluation.replay import Rollout, feel_out
from tactile_core.exploration.acting import find_policy
from tactile_core.exploration.at_hand import POLICIES, UNET, at_hand
from tactile_core.exploration.environments import as_reconstructor
from tactile_core.exploration.world.circle import circle_pixels
from tactile_core.exploration.world.rays import cast_rays, ray_ends
from tactile_core.figures.animation import rollout_gif
from tactile_core.figures.curves import drawn
from tactile_core.figures.rollouts import draw_prediction, draw_ray, draw_touches, name_signs
from tactile_core.figures.style import INK, MUTED, picture, plot, png, policy_lines

DOCS = Path(__file__).parent
SEED = 30  # of a generated mug whose handle is seen
RAYS = 10


def felt_out(name: str, mask: np.ndarray) -> Rollout:
    """Ten rays of the policy `name` at a mug (R, R), as `tactile feel mug` has them."""
    reconstructor = as_reconstructor(at_hand(UNET, POLICIES) / "unet")
    rollout = feel_out(find_policy(name, reconstructor), mask, reconstructor, RAYS, seed=SEED)
    return replace(rollout, category="mug")


def ray_figure(mask: np.ndarray) -> Figure:
    """A ray with its touch, and one that misses."""
    figure = Figure(figsize=(4.4, 4.9), layout="constrained")
    axes = picture(figure.subplots())
    draw_prediction(axes, mask, np.zeros(mask.shape))
    pixels = len(circle_pixels(len(mask)))
    rays = np.array([[0.55, 0.05], [0.30, 0.08]]) * pixels
    touches = cast_rays(np.stack([mask, mask]), rays.astype(int))
    ends = ray_ends(rays.astype(int), len(mask))
    for ray, touch in zip(ends, touches, strict=True):
        draw_ray(axes, ray, touch, width=1.6)
    draw_touches(axes, touches, size=60)
    words = {"alpha": ends[0, :2], "beta": ends[0, 2:], "touch": touches[0], "a miss": ends[1, :2]}
    for word, (row, column) in words.items():
        axes.annotate(word, (column, row), (6, 6), textcoords="offset points", color=INK, size=10)
    name_signs(figure, columns=2)
    return figure


def reconstruction_figure(rollout: Rollout) -> Figure:
    """What the U-Net makes of the touches after the first, third and tenth ray."""
    figure = Figure(figsize=(8, 2.9), layout="constrained")
    for axes, count in zip(figure.subplots(1, 3), (1, 3, RAYS), strict=True):
        draw_prediction(picture(axes), rollout.mask, rollout.predictions[count - 1])
        draw_touches(axes, rollout.touches[:count], size=30)
        words = f"{count} ray{'s' * (count > 1)}: Jaccard {rollout.jaccard[count - 1]:.0f}"
        axes.set_title(words, fontsize=9.5, color=INK)
        inside = len(rollout.mask) // 4 - 2
        axes.set_xlim(inside, len(rollout.mask) - inside)
        axes.set_ylim(len(rollout.mask) - inside, inside)
    name_signs(figure, columns=5)
    return figure


def gap_figure(curve: pd.DataFrame) -> Figure:
    """How far `recall` has come from `random` towards the oracle, ray by ray."""
    figure = Figure(figsize=(8, 3.8), layout="constrained")
    axes = plot(figure.subplots(), "Gap closed", "rays cast", "Jaccard index")
    names = ("random", "recall", "oracle")
    rows = {name: curve[curve["policy"] == name].set_index("step")["mean"] for name in names}
    lines = policy_lines(curve["policy"])
    for name in names:
        axes.add_line(drawn(lines[name], rows[name].index, rows[name]))
        at = (RAYS, rows[name][RAYS])
        words = f"{name} {at[1]:.1f}"
        axes.annotate(
            words, at, (10, -3), textcoords="offset points", color=lines[name].colour, size=9
        )
    axes.set_xlim(0.8, RAYS + 1.2)
    axes.set_xticks(range(1, RAYS + 1))
    axes.autoscale_view(scalex=False)
    low, here, high = (rows[name][RAYS] for name in names)
    for x, top, words in (
        (RAYS - 0.15, here, f"{here - low:.1f}"),
        (RAYS + 0.15, high, f"{high - low:.1f}"),
    ):
        axes.annotate("", (x, top), (x, low), arrowprops={"arrowstyle": "<->", "color": MUTED})
        side = "right" if x < RAYS else "left"
        axes.text(x, (low + here) / 2, f" {words} ", ha=side, color=INK, fontsize=9)
    way, whole = here - low, high - low
    words = f"gap closed at ten: {way:.1f} / {whole:.1f} = {way / whole:.0%}"
    axes.text(0.99, 0.05, words, transform=axes.transAxes, ha="right", color=INK, fontsize=10)
    return figure


def main() -> None:
    mug = generated_thing("mug", 64, SEED).mask
    rollout = felt_out("recall", mug)
    curve = pd.read_csv(DOCS / "results" / "study" / "per_step_curve.csv")
    (DOCS / "assets" / "mug.gif").write_bytes(rollout_gif(rollout))
    (DOCS / "assets" / "ray.png").write_bytes(png(ray_figure(mug), width_px=440))
    (DOCS / "assets" / "reconstruction.png").write_bytes(png(reconstruction_figure(rollout)))
    (DOCS / "assets" / "gap.png").write_bytes(png(gap_figure(curve)))


if __name__ == "__main__":
    main()
