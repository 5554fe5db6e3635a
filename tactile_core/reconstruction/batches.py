"""Training batches: masks with touches drawn afresh each time."""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from tactile_core.dataset.rendering.pictures import portions
from tactile_core.dataset.shapes import Shapes

# Draws touches for the shapes at `indices` (B,): returns points (B, K, 2) int and which of
# them count, (B, K) bool.
DrawTouches = Callable[[np.random.Generator, np.ndarray], tuple[np.ndarray, np.ndarray]]

# Draws what was felt of the shapes at `indices` (B,): images (B, R, R) int8, 1 at a touch, 0
# where nothing is known and, for a U-Net that sees free space, −1 where a ray has passed.
DrawFelt = Callable[[np.random.Generator, np.ndarray], np.ndarray]


class TouchSource(NamedTuple):
    """Where the touches come from that a U-Net is trained with.

    key : of all that `draw` draws from, beyond the train shapes themselves
    """

    draw: DrawFelt
    key: str


FEWEST, MOST = 1, 10  # touches held, as the report trains (section V)
ORIENTATIONS = 8


def outline_touches(shapes: Shapes, fewest: int = FEWEST, most: int = MOST) -> DrawTouches:
    """Draws `fewest` to `most` different touches uniformly from each outline, and never more than
    the outline has."""
    lengths = np.array([len(outline) for outline in shapes.outlines])
    longest = max(lengths.max(), most)

    def draw(rng: np.random.Generator, indices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        points = np.zeros((len(indices), most, 2), np.int16)
        for some in portions(len(indices)):
            own = lengths[indices[some], None]
            keys = rng.random((len(own), longest))
            keys[np.arange(longest) >= own] = 1.0  # beyond the end: after all others
            chosen = np.argsort(keys, axis=1)[:, :most]
            for row, index, places in zip(points[some], indices[some], chosen, strict=True):
                places = places[: lengths[index]]
                row[: len(places)] = shapes.outlines[index][places]
        count = rng.integers(fewest, most + 1, (len(indices), 1))
        return points, np.arange(most) < np.minimum(count, lengths[indices, None])

    return draw


def draw_touch_sets(
    shapes: Shapes, rng: np.random.Generator, fewest: int = FEWEST, most: int = MOST
) -> list[np.ndarray]:
    """One set (k, 2) of `fewest` to `most` touches of each shape's outline."""
    points, held = outline_touches(shapes, fewest, most)(rng, np.arange(len(shapes)))
    return [some[which] for some, which in zip(points, held, strict=True)]


def felt_outlines(shapes: Shapes, fewest: int = FEWEST, most: int = MOST) -> DrawFelt:
    """Draws images of `fewest` to `most` touches of each outline."""
    touches = outline_touches(shapes, fewest, most)

    def draw(rng: np.random.Generator, indices: np.ndarray) -> np.ndarray:
        return touch_images(*touches(rng, indices), shapes.resolution)

    return draw


def outline_source(shapes: Shapes) -> TouchSource:
    """Draws 1 to 10 touches uniformly from each outline, afresh each time."""
    return TouchSource(felt_outlines(shapes), key="outline")


def touch_images(points: np.ndarray, held: np.ndarray, resolution: int) -> np.ndarray:
    """Touches (B, K, 2) of which `held` (B, K) count, as images (B, R, R) int8, 0 or 1."""
    images = np.zeros((len(points), resolution, resolution), np.int8)
    image, touch = np.nonzero(held)
    rows, columns = points[image, touch].T
    images[image, rows, columns] = 1
    return images


def training_batches(
    shapes: Shapes,
    batch_size: int,
    rng: np.random.Generator,
    draw: DrawFelt,
    samples: int | None = None,
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """One epoch in random order: indices (B,), felt (B, R, R) int8 and masks (B, R, R) bool.

    Each batch is turned and flipped into one of its eight orientations: a shape seen from
    the other side is as good a shape. `samples` ends the epoch early.
    """
    order = rng.permutation(len(shapes))[:samples]
    ends = list(range(batch_size, len(order), batch_size))
    if ends and len(order) - ends[-1] == 1:
        ends.pop()  # a batch of one cannot be normalised: it joins the one before
    for indices in np.split(order, ends):
        felt, masks = draw(rng, indices), shapes.packed[indices]
        orientation = int(rng.integers(ORIENTATIONS))
        yield indices, orient(felt, orientation), orient(masks, orientation)


def orient(images: np.ndarray, orientation: int) -> np.ndarray:
    """Images (B, R, R) in one of eight orientations: quarter turns, then a flip."""
    turned = np.rot90(images, orientation % 4, axes=(1, 2))
    return np.ascontiguousarray(turned[:, :, ::-1] if orientation >= 4 else turned)
