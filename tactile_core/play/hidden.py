"""Shapes to hide: of the test split, newly generated, drawn, or a file of the player's own."""

from collections.abc import Callable, Mapping
from pathlib import PurePath

import numpy as np

from tactile_core.dataset.drawings import mask_of_picture
from tactile_core.dataset.procedural.models import GENERATORS
from tactile_core.dataset.rendering.pictures import encode_mask
from tactile_core.dataset.things import Thing, generated_thing, thing_in
from tactile_core.errors import TactileError
from tactile_core.play.drawing import Drawing

Maker = Callable[[np.random.Generator], Thing]
FINE = 512  # pixels along a side that a drawing is looked at with


def hiding_places(shapes: Mapping[str, np.ndarray], resolution: int) -> dict[str, Maker]:
    """What can be asked for by name, and who makes it.

    shapes : masks (n, R, R) bool of the test split by class
    """
    stored = {f"{name} of the test split": of_split(name, masks) for name, masks in shapes.items()}
    new = {f"newly generated {name}": generated(name, resolution) for name in GENERATORS}
    return {"any of the test split": any_of([*stored.values()]), **stored, **new}


def any_of(makers: list[Maker]) -> Maker:
    return lambda rng: makers[rng.integers(len(makers))](rng)


def of_split(name: str, masks: np.ndarray) -> Maker:
    def make(rng: np.random.Generator) -> Thing:
        index = int(rng.integers(len(masks)))
        return Thing(masks[index], f"{name} {index} of the test split")

    return make


def generated(name: str, resolution: int) -> Maker:
    return lambda rng: generated_thing(name, resolution, int(rng.integers(2**31)))


def drawn(drawing: Drawing, resolution: int) -> Thing:
    """What a drawing encloses, centred and scaled as the camera would show it.

    Raises `TactileError` where it encloses nothing.
    """
    inside = drawing.enclosed(FINE)
    if not inside.any():
        raise TactileError("There is no shape yet: draw its outline first")
    # In a margin: a line may lead beyond the picture, whose border then is not all background.
    picture = encode_mask(np.pad(~inside, 1, constant_values=True))
    return Thing(mask_of_picture(picture, resolution).mask, "what you drew")


def brought(data: bytes, name: str, resolution: int) -> Thing:
    """The mesh or picture in a file's bytes; raises `TactileError` where it is none."""
    try:
        thing = thing_in(data, PurePath(name).suffix, resolution)
    except TactileError as error:
        raise TactileError(f"{name} {error}") from error
    return Thing(thing.mask, name)
