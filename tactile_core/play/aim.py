"""From a pointer or keys to a ray: what is aimed at is always a ray of the report's (section VI.A).

Places are (row, column) in pixels; a pixel's centre lies at whole numbers. A ray is (alpha, beta),
two different indices into `circle_pixels`.
"""

from dataclasses import dataclass

import numpy as np

from tactile_core.exploration.world.circle import angle_index, circle_pixels, middle

Place = tuple[float, float]
Ray = tuple[int, int]

# Of the image's side: a pointer that moves less between press and release has clicked.
STILL = 1 / 32
# Keys, by their names in browsers, and how many pixels of the circle they move a ray by.
TURN = {"ArrowLeft": 1, "ArrowRight": -1}
SWING = {"ArrowUp": 1, "ArrowDown": -1}
FAST = 8  # times as many
CAST = ("Enter", " ")
DROP = "Escape"


def nearest(place: Place, resolution: int) -> int:
    """The circle's pixel in the direction of a place."""
    row, column = np.asarray(place) - middle(resolution)
    return int(angle_index(np.arctan2(column, row), resolution))


def through(alpha: int, place: Place, resolution: int) -> Ray:
    """The ray that starts at alpha and passes a place inside the circle, or ends nearest to one
    outside."""
    radius = middle(resolution)
    start = circle_pixels(resolution)[alpha].astype(float) - radius
    here = np.asarray(place, float) - radius
    along = here - start
    if here @ here < radius**2 and start @ along < 0:
        here = start - 2 * (start @ along) / (along @ along) * along  # where it leaves the circle
    beta = nearest((here[0] + radius, here[1] + radius), resolution)
    return (alpha, beta) if beta != alpha else across(alpha, resolution)


def across(alpha: int, resolution: int) -> Ray:
    """The ray that starts at alpha and passes the middle."""
    row, column = 2 * middle(resolution) - circle_pixels(resolution)[alpha].astype(float)
    return alpha, nearest((row, column), resolution)


def turned(ray: Ray, steps: int, resolution: int) -> Ray:
    """The ray turned about the middle by so many pixels of the circle."""
    pixels = len(circle_pixels(resolution))
    return (ray[0] + steps) % pixels, (ray[1] + steps) % pixels


def swung(ray: Ray, steps: int, resolution: int) -> Ray:
    """The ray swung about its start by so many pixels of the circle; past its start it stops."""
    pixels = len(circle_pixels(resolution))
    ahead = (ray[1] - ray[0]) % pixels
    return ray[0], (ray[0] + min(max(ahead + steps, 1), pixels - 1)) % pixels


@dataclass
class Aim:
    """Where the next ray of a player would go. Press at its start and drag, click twice, or keys.

    start : the circle's pixel under the pointer, or where the ray begins once that was chosen
    ray : the ray that is aimed at, None while only its start is looked for
    """

    resolution: int
    start: int | None = None
    ray: Ray | None = None
    pressed: Place | None = None
    clicked: bool = False  # the start is chosen, and the button was let go
    last: Place | None = None  # browsers tell of moves that are none when the page changes

    def press(self, place: Place) -> None:
        self.pressed = place
        if self.clicked and self.start is not None:
            self.ray = through(self.start, place, self.resolution)
        else:
            self.start, self.ray = nearest(place, self.resolution), None

    def move(self, place: Place) -> None:
        if place == self.last:
            return
        self.last = place
        if self.start is not None and (self.clicked or self._dragged(place)):
            self.ray = through(self.start, place, self.resolution)
        elif self.pressed is None:
            self.start, self.ray = nearest(place, self.resolution), None

    def release(self, place: Place) -> Ray | None:
        """The ray that is cast now, if any."""
        if self.pressed is None or self.start is None:
            return None
        if self.clicked or self._dragged(place):
            ray = through(self.start, place, self.resolution)
            self.drop()
            return ray
        self.pressed, self.clicked = None, True
        return None

    def key(self, name: str, fast: bool) -> Ray | None:
        """Arrows turn the ray about the middle or swing it about its start.

        Returns the ray that is cast now, if any; it stays in sight for the next one.
        """
        steps = FAST if fast else 1
        ray = self.ray or across(self.start or 0, self.resolution)
        if name in TURN or name in SWING:
            ray = turned(ray, TURN.get(name, 0) * steps, self.resolution)
            ray = swung(ray, SWING.get(name, 0) * steps, self.resolution)
            self.start, self.ray, self.clicked = ray[0], ray, False
        elif name == DROP:
            self.drop()
        return self.ray if name in CAST else None

    def drop(self) -> None:
        """Forget what was aimed at."""
        self.start, self.ray, self.pressed, self.clicked = None, None, None, False

    def _dragged(self, place: Place) -> bool:
        if self.pressed is None:
            return False
        moved = np.hypot(place[0] - self.pressed[0], place[1] - self.pressed[1])
        return bool(moved >= STILL * self.resolution)
