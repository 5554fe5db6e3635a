"""One moment of a rollout as a picture: the scene, and beside it its numbers and a legend."""

import numpy as np
from matplotlib.colors import to_rgb
from PIL import Image, ImageDraw, ImageFont
from skimage.measure import find_contours

from tactile_core.evaluation.replay import Rollout
from tactile_core.figures.style import FAINT, INK, MUTED, PINK, RAY, SHAPE, TINT, YELLOW

SIDE = 320  # of the scene, in pixels
PANEL = 240  # width of what stands beside it
FINE = 2  # drawn so many times finer, for smooth edges
LEFT = SIDE + 14  # where the panel's words begin
BARS_TOP, BARS_BOTTOM = 96, 158
LEGEND_TOP, LEGEND_STEP = 192, 23
ENTRIES = ("object", "reconstruction", "ray", "touch", "ray that missed")


def draw_moment(
    rollout: Rollout, step: int, prediction: np.ndarray, score: float, travel: float = 1.0
) -> Image.Image:
    """The moment when ray `step` travels (below 1), has arrived, or, past the last one, no ray.

    prediction : (R, R) probability that is shown; score : the Jaccard index that is shown, 0–100
    """
    image = Image.new("RGB", (FINE * (SIDE + PANEL), FINE * SIDE), "white")
    image.paste(tinted(rollout.mask, prediction).resize((FINE * SIDE, FINE * SIDE)))
    draw = ImageDraw.Draw(image)
    draw_circle(draw, rollout.mask)
    for contour in find_contours(np.pad(rollout.mask, 1).astype(float), 0.5):
        line = [on_image(point - 1, rollout.mask) for point in contour]
        draw.line(line, fill=MUTED, width=FINE)
    if step < len(rollout.rays):
        draw_ray(draw, rollout, step, travel)
    arrived = min(step + (travel == 1), len(rollout.rays))
    for number, touch in enumerate(rollout.touches[:arrived]):
        if touch[0] >= 0:
            draw_touch(draw, on_image(touch, rollout.mask), 5.5 if number == step else 4)
    draw_numbers(draw, rollout, arrived, score)
    draw_legend(draw)
    return image.reduce(FINE)


def tinted(mask: np.ndarray, prediction: np.ndarray) -> Image.Image:
    """The object in grey on white, and over both as much pink as is predicted; (R, R)."""
    ground = np.where(mask[..., None], to_rgb(SHAPE), 1.0)
    shown = ground + TINT * prediction[..., None] * (np.array(to_rgb(PINK)) - ground)
    return Image.fromarray((255 * shown).round().astype(np.uint8))


def on_image(point: np.ndarray, mask: np.ndarray) -> tuple[float, float]:
    """Where the centre of pixel (row, column) lies in the fine image, as (x, y)."""
    scale = FINE * SIDE / len(mask)
    return (point[1] + 0.5) * scale, (point[0] + 0.5) * scale


def draw_circle(draw: ImageDraw.ImageDraw, mask: np.ndarray) -> None:
    """The circle that rays start from."""
    middle = len(mask) / 2 - 1
    radius = middle * FINE * SIDE / len(mask)
    draw.circle(on_image(np.array([middle, middle]), mask), radius, outline=FAINT, width=FINE)


def draw_ray(draw: ImageDraw.ImageDraw, rollout: Rollout, step: int, travel: float) -> None:
    """The ray as far as it has come, at most to its touch; dashed where it misses."""
    start, end = rollout.rays[step, :2], rollout.rays[step, 2:]
    missed = rollout.touches[step, 0] < 0
    tip = start + travel * ((end if missed else rollout.touches[step]) - start)
    ends = on_image(start, rollout.mask), on_image(tip, rollout.mask)
    (draw_dashes if missed else draw_line)(draw, *ends)
    draw.circle(ends[0], FINE * 3, fill=MUTED if missed else RAY)


def draw_line(
    draw: ImageDraw.ImageDraw, start: tuple[float, float], end: tuple[float, float]
) -> None:
    draw.line([start, end], fill=RAY, width=2 * FINE)


def draw_dashes(
    draw: ImageDraw.ImageDraw, start: tuple[float, float], end: tuple[float, float]
) -> None:
    way = np.array(end) - start
    marks = np.arange(0, max(np.hypot(*way), 1), FINE * 9)
    for mark in marks / max(np.hypot(*way), 1):
        until = min(1.0, mark + FINE * 5 / max(np.hypot(*way), 1))
        draw.line([tuple(start + mark * way), tuple(start + until * way)], fill=MUTED, width=FINE)


def draw_touch(draw: ImageDraw.ImageDraw, at: tuple[float, float], radius: float) -> None:
    """A yellow dot with a dark rim."""
    draw.circle(at, FINE * (radius + 1), fill=INK)
    draw.circle(at, FINE * radius, fill=YELLOW)


def draw_numbers(draw: ImageDraw.ImageDraw, rollout: Rollout, arrived: int, score: float) -> None:
    """Who feels out what, the Jaccard index, and a bar of it for each ray that arrived."""
    what = f" feels out a {rollout.category}" if rollout.category else ""
    write(draw, (LEFT, 26), rollout.policy + what, 14, INK)
    write(draw, (LEFT, 70), "Jaccard index", 14, MUTED)
    write(draw, (SIDE + PANEL - 18, 72), f"{score:.0f}", 34, INK, anchor="rs")
    width = (PANEL - 32) / len(rollout.rays)
    for step in range(len(rollout.rays)):
        left = LEFT + step * width
        height = (BARS_BOTTOM - BARS_TOP) * rollout.jaccard[step] / 100 if step < arrived else 1
        missed = rollout.touches[step, 0] < 0
        colour = FAINT if step >= arrived else SHAPE if missed else PINK
        box = (left, BARS_BOTTOM - height, left + width - 3, BARS_BOTTOM)
        draw.rectangle([FINE * edge for edge in box], fill=colour)
    write(draw, (LEFT, BARS_BOTTOM + 16), f"after each of {len(rollout.rays)} rays", 11, MUTED)


def draw_legend(draw: ImageDraw.ImageDraw) -> None:
    """What each sign of the scene stands for."""
    for number, name in enumerate(ENTRIES):
        y = LEGEND_TOP + 12 + LEGEND_STEP * number
        left, right = (FINE * LEFT, FINE * y), (FINE * (LEFT + 22), FINE * y)
        middle = ((left[0] + right[0]) / 2, FINE * y)
        square = [middle[0] - FINE * 7, FINE * (y - 7), middle[0] + FINE * 7, FINE * (y + 7)]
        if name == "object":
            draw.rectangle(square, fill=SHAPE, outline=MUTED, width=FINE)
        elif name == "reconstruction":
            pink = tinted(np.zeros((1, 1), bool), np.ones((1, 1))).getpixel((0, 0))
            draw.rectangle(square, fill=pink)
        elif name == "touch":
            draw_touch(draw, middle, 4)
        else:
            (draw_line if name == "ray" else draw_dashes)(draw, left, right)
        write(draw, (LEFT + 32, y + 5), name, 13, INK)


def write(
    draw: ImageDraw.ImageDraw,
    at: tuple[float, float],
    words: str,
    size: int,
    colour: str,
    anchor: str = "ls",
) -> None:
    font = ImageFont.load_default(FINE * size)
    draw.text((FINE * at[0], FINE * at[1]), words, fill=colour, font=font, anchor=anchor)
