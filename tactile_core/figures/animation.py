"""One rollout as a short animation: a GIF for metadata and for the README."""

import io
from collections.abc import Iterator

import numpy as np
from matplotlib.colors import to_rgb
from PIL import Image, ImageDraw, ImageFont
from skimage.measure import find_contours

from tactile_core.evaluation.replay import Rollout
from tactile_core.figures.style import NIGHT, PINK, YELLOW, glow

SIDE = 320  # of the scene, in pixels
HEADER, FOOTER = 44, 58
FINE = 2  # drawn so many times finer, for smooth edges
TRUTH = "#6b7386"
RING = "#262a34"
LIGHT = "#eef1f6"
DIM = "#8d95a5"
TRAVEL = (0.3, 0.6, 0.85, 1.0)  # how far a ray has come, frame by frame
FADE = (0.35, 0.7, 1.0)  # how far the prediction has changed, frame by frame
FRAME_MS, HOLD_MS, END_MS = 50, 450, 2500


def rollout_gif(rollout: Rollout) -> bytes:
    """The rays of a rollout arriving one by one while the prediction fills the true outline.

    An endless GIF of 320 pixels' width. Equal rollouts give equal bytes.
    """
    frames, durations = zip(*draw_frames(rollout), strict=True)
    colours = palette()
    first, *others = (frame.quantize(palette=colours, dither=Image.Dither.NONE) for frame in frames)
    file = io.BytesIO()
    first.save(
        file, format="GIF", save_all=True, append_images=others, duration=list(durations), loop=0,
        optimize=False, disposal=1,
    )  # fmt: skip
    return file.getvalue()


def palette() -> Image.Image:
    """The colours that a frame may hold: each one fading into the dark, in even steps.

    One palette for all frames, so that what does not change costs nothing.
    """
    steps = {PINK: 28, YELLOW: 8, LIGHT: 10, DIM: 6, TRUTH: 6, RING: 3}
    fading = [glow(np.linspace(0, 1, count)[1:, None], colour) for colour, count in steps.items()]
    colours = np.concatenate([np.array(to_rgb(NIGHT)).reshape(1, 1, 3), *fading])
    image = Image.new("P", (1, 1))
    image.putpalette((255 * colours).round().astype(np.uint8).tobytes())
    return image


def draw_frames(rollout: Rollout) -> Iterator[tuple[Image.Image, int]]:
    """Every frame with its duration in milliseconds."""
    before, score = np.zeros_like(rollout.predictions[0]), 0.0
    for step, (after, reached) in enumerate(zip(rollout.predictions, rollout.jaccard, strict=True)):
        for travel in TRAVEL:
            yield draw_frame(rollout, step, before, score, travel), FRAME_MS
        for fade in FADE:
            shown = before + fade * (after - before)
            yield draw_frame(rollout, step, shown, score + fade * (reached - score)), FRAME_MS
        yield draw_frame(rollout, step, after, reached), HOLD_MS
        before, score = after, reached
    yield draw_frame(rollout, len(rollout.rays), before, score), END_MS


def draw_frame(
    rollout: Rollout, step: int, prediction: np.ndarray, score: float, travel: float = 1.0
) -> Image.Image:
    """One frame while ray `step` travels (below 1), has arrived, or, past the last one, without."""
    image = Image.new("RGB", (FINE * SIDE, FINE * (HEADER + SIDE + FOOTER)), NIGHT)
    scene = Image.fromarray((255 * glow(prediction, PINK)).round().astype(np.uint8))
    image.paste(
        scene.resize((FINE * SIDE, FINE * SIDE), Image.Resampling.BICUBIC), (0, FINE * HEADER)
    )
    draw = ImageDraw.Draw(image)
    draw_circle(draw, rollout.mask)
    draw_truth(draw, rollout.mask)
    if step < len(rollout.rays):
        draw_ray(draw, rollout, step, travel)
    arrived = step + (travel == 1)
    for number, touch in enumerate(rollout.touches[:arrived]):
        if touch[0] >= 0:
            draw_dot(draw, on_image(touch, rollout.mask), 5.5 if number == step else 3.5, YELLOW)
    draw_words(draw, rollout, min(arrived, len(rollout.rays)), score)
    return image.reduce(FINE)


def on_image(point: np.ndarray, mask: np.ndarray) -> tuple[float, float]:
    """Where the centre of pixel (row, column) lies in the fine image, as (x, y)."""
    scale = FINE * SIDE / len(mask)
    return (point[1] + 0.5) * scale, (point[0] + 0.5) * scale + FINE * HEADER


def draw_circle(draw: ImageDraw.ImageDraw, mask: np.ndarray) -> None:
    """The circle that rays start from, faint."""
    middle = len(mask) / 2 - 1
    radius = middle * FINE * SIDE / len(mask)
    draw.circle(on_image(np.array([middle, middle]), mask), radius, outline=RING, width=FINE)


def draw_truth(draw: ImageDraw.ImageDraw, mask: np.ndarray) -> None:
    """The true outline, faint."""
    for contour in find_contours(np.pad(mask, 1).astype(float), 0.5):
        draw.line([on_image(point - 1, mask) for point in contour], fill=TRUTH, width=FINE)


def draw_ray(draw: ImageDraw.ImageDraw, rollout: Rollout, step: int, travel: float) -> None:
    """The ray from its start as far as it has come, at most to its touch."""
    start, end = rollout.rays[step, :2], rollout.rays[step, 2:]
    touch = rollout.touches[step]
    goal = end if touch[0] < 0 else touch
    tip = start + travel * (goal - start)
    colour = DIM if touch[0] < 0 and travel == 1 else LIGHT
    draw.line([on_image(start, rollout.mask), on_image(tip, rollout.mask)], fill=colour, width=FINE)
    draw_dot(draw, on_image(start, rollout.mask), 2.5, colour)


def draw_dot(
    draw: ImageDraw.ImageDraw, at: tuple[float, float], radius: float, colour: str
) -> None:
    """A dot with a dark rim."""
    draw.circle(at, FINE * (radius + 1), fill=NIGHT)
    draw.circle(at, FINE * radius, fill=colour)


def draw_words(draw: ImageDraw.ImageDraw, rollout: Rollout, arrived: int, score: float) -> None:
    """Policy and Jaccard index above the scene; below it a bar per ray that arrived."""
    small, large = (ImageFont.load_default(FINE * size) for size in (14, 22))
    baseline = FINE * 30
    draw.text((FINE * 14, baseline), rollout.policy, fill=LIGHT, font=small, anchor="ls")
    draw.text((FINE * (SIDE - 14), baseline), f"{score:.0f}", fill=LIGHT, font=large, anchor="rs")
    draw.text((FINE * (SIDE - 46), baseline), "Jaccard", fill=DIM, font=small, anchor="rs")
    count = len(rollout.rays)
    width = (SIDE - 28) / count
    for step in range(count):
        left, bottom = 14 + step * width, HEADER + SIDE + FOOTER - 10
        height = 44 * rollout.jaccard[step] / 100 if step < arrived else 1
        box = (left, bottom - height, left + width - 3, bottom)
        missed = rollout.touches[step, 0] < 0
        colour = TRUTH if step >= arrived or missed else PINK
        draw.rectangle([FINE * edge for edge in box], fill=colour)
