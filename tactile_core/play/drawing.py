"""A shape drawn with the pointer: closed loops; one inside another is a hole."""

from dataclasses import dataclass, field

import numpy as np
from skimage.draw import polygon2mask

from tactile_core.play.aim import Place

MOST_PLACES = 4000  # of all loops together; what comes after is not taken


@dataclass
class Drawing:
    """Loops of places (row, column), each closed from its last to its first.

    size : of the picture that it is drawn on, in places
    """

    size: int
    loops: list[list[Place]] = field(default_factory=list)
    down: bool = False

    def press(self, place: Place) -> None:
        self.loops.append([place])
        self.down = True

    def move(self, place: Place) -> None:
        if self.down and sum(map(len, self.loops)) < MOST_PLACES:
            self.loops[-1].append(place)

    def release(self) -> None:
        self.down = False

    def enclosed(self, resolution: int) -> np.ndarray:
        """What the loops enclose in the whole picture, (R, R) bool; a loop inside another is cut
        out of it."""
        inside = np.zeros((resolution, resolution), bool)
        for places in self.loops:
            if len(places) > 2:
                fine = (np.array(places) + 0.5) * resolution / self.size - 0.5
                inside ^= polygon2mask(inside.shape, fine)
        return inside
