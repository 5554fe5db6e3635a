"""Sheets: many masks, touch sets or reconstructions side by side, cropped to where shapes lie."""

from collections.abc import Iterator, Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from tactile_core.dataset.rendering.pictures import decode_masks
from tactile_core.dataset.shapes import as_points
from tactile_core.figures.style import FAINT, INK, MUTED, PINK, SHAPE, YELLOW, glow, picture

# Which reconstructions stand for good, median and bad: quantiles of the Jaccard index.
CASES = {"good": (0.95, 0.85), "median": (0.55, 0.45), "bad": (0.15, 0.05)}


def mask_sheet(pictures: pd.Series, categories: np.ndarray, each: int = 36) -> Figure:
    """Up to `each` of the masks of every category, evenly picked: no others are decoded.

    pictures : N masks as PNG bytes; categories : (N,) str
    """
    figure = Figure(figsize=(8, 1), layout="constrained")
    for axes, chosen in blocks(figure, categories, each, columns=12):
        masks = decode_masks(pictures.iloc[chosen])
        images = np.where(masks[..., None], to_rgb(INK), to_rgb(FAINT))
        axes.imshow(tile(images, columns=12)[0], interpolation="nearest")
    return figure


def touch_sheet(
    pictures: pd.Series,
    outlines: Sequence[np.ndarray],
    touches: Sequence[np.ndarray],
    categories: np.ndarray,
    each: int = 16,
) -> Figure:
    """Up to `each` shapes of every category with their outlines and one touch set each.

    pictures : N masks as PNG bytes; outlines, touches : N arrays (k, 2) or table cells that hold
    such; categories : (N,) str
    """
    figure = Figure(figsize=(8, 1), layout="constrained")
    for axes, chosen in blocks(figure, categories, each, columns=8):
        masks = decode_masks(pictures.iloc[chosen])
        images = np.where(masks[..., None], to_rgb(FAINT), to_rgb("white"))
        for image, index in zip(images, chosen, strict=True):
            image[tuple(as_points(outlines[index]).T)] = to_rgb(MUTED)
        tiled, corners = tile(images, columns=8)
        axes.imshow(tiled, interpolation="nearest")
        for index, corner in zip(chosen, corners, strict=True):
            rows, columns = (as_points(touches[index]) + corner).T
            axes.scatter(columns, rows, s=22, color=YELLOW, edgecolor=INK, linewidth=0.6)
    return figure


def blocks(
    figure: Figure, categories: np.ndarray, each: int, columns: int
) -> Iterator[tuple[Axes, np.ndarray]]:
    """Titled axes for every category, with the indices (n,) to show there in rows of `columns`.

    The figure becomes as tall as they need.
    """
    members = {name: np.flatnonzero(categories == name) for name in sorted(set(categories))}
    shown = {name: some[evenly(len(some), each)] for name, some in members.items()}
    heights = [-(-len(chosen) // columns) for chosen in shown.values()]
    figure.set_figheight(sum(heights) * 8 / columns + 0.32 * len(members))
    grid = figure.subplots(len(members), 1, height_ratios=heights, squeeze=False)[:, 0]
    for axes, (name, chosen) in zip(grid, shown.items(), strict=True):
        whole = len(members[name])
        title = name if len(chosen) == whole else f"{name}  ({len(chosen)} of {whole})"
        picture(axes).set_title(title, loc="left", fontsize=9.5, color=INK, pad=4)
        yield axes, chosen


def evenly(count: int, most: int) -> np.ndarray:
    """At most `most` of the indices 0 … count − 1, evenly spaced."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int))


def tile(images: np.ndarray, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """Images (n, R, R, 3) cropped and laid out in rows as one, and where each of them lies.

    That is (n, 2): what to add to a (row, column) of the image to find it in the whole.
    """
    inner = crop(images)
    size, gap = inner.shape[1], max(1, inner.shape[1] // 24)
    rows = -(-len(images) // columns)
    canvas = np.ones((rows * (size + gap) - gap, columns * (size + gap) - gap, 3))
    corners = np.stack(np.divmod(np.arange(len(images)), columns), axis=1) * (size + gap)
    for image, (row, column) in zip(inner, corners, strict=True):
        canvas[row : row + size, column : column + size] = image
    return canvas, corners - margin(images.shape[1])


def margin(resolution: int) -> int:
    """Pixels outside which no shape lies: all keep within R/4 of the middle."""
    return resolution // 4 - resolution // 32


def crop(images: np.ndarray) -> np.ndarray:
    """The middle of images (n, R, R, …)."""
    inside = slice(margin(images.shape[1]), images.shape[1] - margin(images.shape[1]))
    return images[:, inside, inside]


def reconstruction_sheet(
    touches: Sequence[np.ndarray],
    predictions: np.ndarray,
    masks: np.ndarray,
    jaccard: np.ndarray,
) -> Figure:
    """Good, median and bad reconstructions: touches, prediction and truth, two of each.

    touches : N arrays (k, 2); predictions : (N, R, R) probability; masks : (N, R, R) bool;
    jaccard : (N,)
    """
    figure = Figure(figsize=(8, 4.75), layout="constrained")
    order = np.argsort(jaccard, kind="stable")
    rows = figure.subplots(len(CASES), 6)
    for (case, quantiles), row in zip(CASES.items(), rows, strict=True):
        for start, quantile in zip((0, 3), quantiles, strict=True):
            index = order[round(quantile * (len(order) - 1))]
            panels = row[start : start + 3]
            draw_reconstruction(panels, touches[index], predictions[index], masks[index])
            count = len(touches[index])
            held = "1 touch" if count == 1 else f"{count} touches"
            title = f"{case}: Jaccard {jaccard[index]:.0f}, {held}"
            panels[1].set_title(title, fontsize=9.5, color=INK, pad=4)
    for panel, name in zip(rows[-1], 2 * ("touches", "prediction", "truth"), strict=True):
        panel.text(0.5, -0.05, name, transform=panel.transAxes, fontsize=8.5, color=MUTED,
                   ha="center", va="top")  # fmt: skip
    return figure


def draw_reconstruction(
    panels: Sequence[Axes], touches: np.ndarray, prediction: np.ndarray, mask: np.ndarray
) -> None:
    """Three panels of a sample: touches in yellow, probability in pink, the true shape in grey."""
    colours = (YELLOW, PINK, SHAPE)
    amounts = (np.zeros(mask.shape), prediction, mask)
    for panel, amount, colour in zip(panels, amounts, colours, strict=True):
        picture(panel).imshow(crop(glow(amount, colour)[None])[0], interpolation="nearest")
    rows, columns = (touches - margin(len(mask))).T
    panels[0].scatter(columns, rows, s=16, color=YELLOW, linewidth=0)
