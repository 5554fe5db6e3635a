"""One rollout as a short animation: a GIF for metadata and for the README."""

import io
from collections.abc import Iterator

import numpy as np
from matplotlib.colors import to_rgb
from PIL import Image

from tactile_core.evaluation.replay import Rollout
from tactile_core.figures.scene import draw_moment
from tactile_core.figures.style import FAINT, INK, MUTED, PINK, RAY, SHAPE, TINT, YELLOW, blend

TRAVEL = (0.3, 0.6, 0.85, 1.0)  # how far a ray has come, frame by frame
FADE = (0.35, 0.7, 1.0)  # how far the prediction has changed, frame by frame
FRAME_MS, HOLD_MS, END_MS = 50, 450, 2500


def rollout_gif(rollout: Rollout) -> bytes:
    """The rays of a rollout arriving one by one while the prediction fills the object.

    An endless GIF that begins with the first touch: where nothing plays, that is what is seen.
    Equal rollouts give equal bytes.
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


def draw_frames(rollout: Rollout) -> Iterator[tuple[Image.Image, int]]:
    """Every frame with its duration in milliseconds."""
    first = int((rollout.touches[:, 0] >= 0).argmax())  # the first ray of all where none touches
    before, score = rollout.predictions[first], rollout.jaccard[first]
    yield draw_moment(rollout, first, before, score), HOLD_MS
    for step in range(first + 1, len(rollout.rays)):
        after, reached = rollout.predictions[step], rollout.jaccard[step]
        for travel in TRAVEL:
            yield draw_moment(rollout, step, before, score, travel), FRAME_MS
        for fade in FADE:
            shown = before + fade * (after - before)
            yield draw_moment(rollout, step, shown, score + fade * (reached - score)), FRAME_MS
        yield draw_moment(rollout, step, after, reached), HOLD_MS
        before, score = after, reached
    yield draw_moment(rollout, len(rollout.rays), before, score), END_MS


def palette() -> Image.Image:
    """The colours that a frame may hold: each fading into white, and the object into pink.

    One palette for all frames, so that what does not change costs nothing.
    """
    steps = {INK: 16, MUTED: 10, FAINT: 2, SHAPE: 6, RAY: 12, YELLOW: 8, PINK: 12}
    fading = [fade("white", to_rgb(colour), count) for colour, count in steps.items()]
    fading += [fade(ground, blend(ground, PINK, TINT), 24) for ground in ("white", SHAPE)]
    fading += [fade(rim, to_rgb(YELLOW), 8) for rim in (INK, MUTED)]
    colours = np.concatenate(fading)
    image = Image.new("P", (1, 1))
    image.putpalette((255 * colours).round().astype(np.uint8).tobytes())
    return image


def fade(start: str, end: tuple[float, float, float], steps: int) -> np.ndarray:
    """Colours (steps + 1, 3), 0 to 1, from one to another in even steps."""
    amount = np.linspace(0, 1, steps + 1)[:, None]
    return np.array(to_rgb(start)) * (1 - amount) + np.array(end) * amount
