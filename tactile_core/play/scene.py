"""What a player sees of a hand, as SVG: reconstruction, uncertainty, rays, touches, misses.

The picture's unit is a pixel of the mask; the centre of pixel (row, column) lies half a unit in.
"""

import base64
import io
from collections.abc import Iterable, Sequence

import numpy as np
from PIL import Image, ImageColor
from skimage.measure import block_reduce, find_contours

from tactile_core.exploration.world.circle import circle_pixels, middle
from tactile_core.figures.style import INK, MUTED, PINK, RAY, SHAPE, YELLOW
from tactile_core.play.aim import Aim, Place, Ray
from tactile_core.play.drawing import Drawing
from tactile_core.play.game import Step, entropy
from tactile_core.reconstruction.jaccard import THRESHOLD

FINEST = 64  # dots of uncertainty across the picture, however many pixels it has
SUREST = 0.25  # bits; pixels of less entropy get no dot
PALE = 0.1  # probability below which nothing is drawn


def hand_svg(
    steps: Sequence[Step], reconstruction: np.ndarray, truth: np.ndarray | None = None
) -> str:
    """What was felt and its reconstruction (R, R); `truth` (R, R) bool is the shape, if shown."""
    size = len(reconstruction)
    parts = [circle_svg(size)]
    if truth is not None:
        parts.append(f'<g class="truth" fill="{SHAPE}">{area(truth)}</g>')
    parts += reconstruction_svg(reconstruction, faint=truth is not None)
    if truth is not None:
        parts.append(
            f'<g class="truth" fill="none" stroke="{INK}" stroke-width="{size / 110}"'
            f' stroke-dasharray="{size / 50} {size / 90}">{area(truth)}</g>'
        )
    parts += steps_svg(steps, size)
    return svg(parts, size)


def svg(parts: Iterable[str], size: int) -> str:
    corner, side = frame(size)
    box = f"{corner} {corner} {side} {side}"
    return f'<svg viewBox="{box}" aria-hidden="true">{"".join(parts)}</svg>'


def frame(size: int) -> tuple[float, float]:
    """Left and upper edge of a picture, and its side: the circle, and a margin for its dots."""
    margin = size / 40
    return middle(size) + 0.5 - size / 2 - margin, size + 2 * margin


def place_at(share: Place, size: int) -> Place:
    """The place (row, column) in pixels at a share (down, right) of a picture, 0–1."""
    corner, side = frame(size)
    return corner + share[0] * side - 0.5, corner + share[1] * side - 0.5


def circle_svg(size: int) -> str:
    """The circle that rays start and end on."""
    centre = middle(size) + 0.5
    return (
        f'<circle cx="{centre}" cy="{centre}" r="{middle(size)}" fill="#fff" stroke="{SHAPE}" '
        f'stroke-width="{size / 160}"/>'
    )


def reconstruction_svg(probability: np.ndarray, faint: bool = False) -> list[str]:
    """Probability (R, R) as pink, its outline at one half, and dots where it is uncertain."""
    size = len(probability)
    bits = block_reduce(entropy(probability), max(1, size // FINEST), np.max)
    cell = size / len(bits)
    dots = [
        f"M{number(x * cell)} {number(y * cell)}h{number(side)}v{number(side)}h{number(-side)}z"
        for row, column in np.argwhere(bits > SUREST)
        for side in [0.62 * cell * float(bits[row, column])]
        for x, y in [(column + 0.5 - side / cell / 2, row + 0.5 - side / cell / 2)]
    ]
    return [
        f'<image href="{png_address(probability, 0.5 if faint else 0.75)}" width="{size}" '
        f'height="{size}" preserveAspectRatio="none"/>',
        f'<g fill="none" stroke="{PINK}" stroke-width="{size / 90}" stroke-linejoin="round">'
        f"{area(probability > THRESHOLD, probability)}</g>",
        "" if faint else f'<path class="uncertain" fill="{INK}" fill-opacity=".5" '
        f'd="{"".join(dots)}"/>',
    ]  # fmt: skip


def png_address(probability: np.ndarray, strongest: float) -> str:
    """Probability (R, R) as a `data:` address of a picture: pink, the more opaque the likelier."""
    image = np.empty((*probability.shape, 4), np.uint8)
    image[..., :3] = ImageColor.getrgb(PINK)
    image[..., 3] = np.where(probability > PALE, 255 * strongest * probability, 0)
    file = io.BytesIO()
    Image.fromarray(image).save(file, format="PNG", compress_level=1)
    return f"data:image/png;base64,{base64.b64encode(file.getvalue()).decode()}"


def area(mask: np.ndarray, level: np.ndarray | None = None) -> str:
    """The outline of a mask (R, R) bool as a path, or where `level` (R, R) float is one half."""
    values = mask.astype(float) if level is None else level
    loops = find_contours(np.pad(values, 1), 0.5) if mask.any() else []
    return f'<path fill-rule="evenodd" d="{"".join(loop(points - 1) for points in loops)}"/>'


def loop(points: np.ndarray) -> str:
    """(K, 2) places as a closed path."""
    places = (f"{number(column + 0.5)} {number(row + 0.5)}" for row, column in points)
    return f"M{'L'.join(places)}Z"


def steps_svg(steps: Sequence[Step], size: int) -> list[str]:
    """Rays under touches; the last of each stands out."""
    rays = [ray_svg(step, size, last=step is steps[-1]) for step in steps]
    touches = [touch_svg(step, size, last=step is steps[-1]) for step in steps if step.touch]
    return rays + touches


def ray_svg(step: Step, size: int, last: bool) -> str:
    """A ray from a dot to its touch; one that missed is dashed and ends in a cross."""
    (x1, y1), (x2, y2) = ends(step.ray, size)
    colour = MUTED if step.touch is None else RAY
    if step.touch is not None:
        x2, y2 = step.touch[1] + 0.5, step.touch[0] + 0.5
    dashes = f' stroke-dasharray="{size / 45} {size / 60}"' if step.touch is None else ""
    line = f'<path d="M{x1} {y1}L{x2} {y2}"{dashes}/>'
    if step.touch is None:
        arm = size / 70
        cross = f"l{2 * arm} {2 * arm}m0 {-2 * arm}l{-2 * arm} {2 * arm}"
        line += f'<path d="M{x2 - arm} {y2 - arm}{cross}"/>'
    kind = "miss" if step.touch is None else "ray"
    return (
        f'<g class="{kind}" stroke="{colour}" stroke-width="{size / (110 if last else 180)}" '
        f'opacity="{1 if last else 0.6}" fill="none">{line}'
        f'<circle cx="{x1}" cy="{y1}" r="{size / 80}" fill="{colour}" stroke="none"/></g>'
    )


def touch_svg(step: Step, size: int, last: bool) -> str:
    assert step.touch is not None
    row, column = step.touch
    return (
        f'<circle class="touch" cx="{column + 0.5}" cy="{row + 0.5}" '
        f'r="{size / (42 if last else 55)}" fill="{YELLOW}" stroke="{INK}" '
        f'stroke-width="{size / 140}"/>'
    )


def aim_svg(aim: Aim) -> str:
    """The ray under the pointer, or the place that it would start at."""
    size, parts = aim.resolution, []
    if aim.ray is not None:
        (x1, y1), (x2, y2) = ends(aim.ray, size)
        parts.append(
            f'<path class="aim" d="M{x1} {y1}L{x2} {y2}" stroke="{RAY}" '
            f'stroke-width="{size / 130}" stroke-dasharray="{size / 200} {size / 70}" '
            f'stroke-linecap="round"/>'
        )
    if aim.start is not None:
        row, column = circle_pixels(size)[aim.start] + 0.5
        parts.append(
            f'<circle class="start" cx="{column}" cy="{row}" r="{size / 42}" fill="#fff" '
            f'stroke="{RAY}" stroke-width="{size / 110}"/>'
        )
    return svg(parts, size)


def ends(ray: Ray, size: int) -> tuple[tuple[float, float], tuple[float, float]]:
    """Where a ray starts and ends, as (x, y) each."""
    alpha, beta = (circle_pixels(size)[index] + 0.5 for index in ray)
    return (float(alpha[1]), float(alpha[0])), (float(beta[1]), float(beta[0]))


def drawing_svg(drawing: Drawing) -> str:
    """A drawing under way: its loops, and what they enclose."""
    size = drawing.size
    lines = "".join(
        f'<path d="M{"L".join(f"{number(x + 0.5)} {number(y + 0.5)}" for y, x in places)}"/>'
        for places in drawing.loops
    )
    return svg(
        [
            circle_svg(size),
            f'<g fill="{SHAPE}">{area(drawing.enclosed(size))}</g>',
            f'<g fill="none" stroke="{INK}" stroke-width="{size / 90}" stroke-linejoin="round">'
            f"{lines}</g>",
        ],
        size,
    )


def number(value: float) -> str:
    """Short enough for a picture that goes through a socket at every ray."""
    return f"{value:.2f}"
