"""One player's picture on the page: what was felt, and where a pointer aims."""

from collections.abc import Awaitable, Callable

import numpy as np
from nicegui import events, ui

from tactile_core.exploration.world.rays import RAYS
from tactile_core.play.aim import CAST, DROP, SWING, TURN, Place
from tactile_core.play.game import Hand, Step, uncertain_pixels
from tactile_core.play.scene import hand_svg

# Where the pointer is, as shares of the picture's height and width; told while it is over it.
WHERE = """(event) => {
  const box = event.currentTarget.getBoundingClientRect();
  if (event.type === "pointerdown") event.currentTarget.setPointerCapture(event.pointerId);
  emit((event.clientY - box.top) / box.height, (event.clientX - box.left) / box.width);
}"""
NEW_GAME = ("n", "N")
KEYS = [*TURN, *SWING, *CAST, DROP, *NEW_GAME]
# A key of the game does not scroll the page.
PRESSED = f"""(event) => {{
  if (!{KEYS}.includes(event.key) || event.ctrlKey || event.metaKey || event.altKey) return;
  event.preventDefault();
  emit(event.key, event.shiftKey);
}}"""
BETWEEN_MOVES = 0.02  # seconds

Told = Callable[[Place], Awaitable[None] | None]
Key = Callable[[str, bool], Awaitable[None] | None]
LEFT = "○"


class Board:
    """A picture with a title and a score above, a row of ten rays and who casts them below."""

    def __init__(self, title: str, name: str) -> None:
        self.section = ui.element("section").classes(f"board {name}")
        with self.section:
            with ui.element("header"):
                self.title = ui.label(title).classes("title")
                self.score = ui.label().classes("score")
            self.surface = ui.element("div").classes("surface")
            with self.surface:
                self.scene = ui.html(sanitize=False).classes("layer")
                self.overlay = ui.html(sanitize=False).classes("layer")
            self.rays = ui.label().classes("rays").props("aria-hidden=true")
            self.about = ui.label().classes("about")

    def show(self, hand: Hand, rays: int, truth: np.ndarray | None) -> None:
        """A hand after so many rays; `truth` (R, R) bool is the shape, once it is shown."""
        reconstruction = hand.reconstruction(rays)
        self.section.visible = True
        self.scene.content = hand_svg(hand.steps[:rays], reconstruction, truth)
        self.score.text = (
            f"Jaccard {hand.curve(rays)[-1]:.1f} · {uncertain_pixels(reconstruction):.0f} pixels "
            "uncertain"
        )
        marks = [mark(step) for step in hand.steps[:rays]]
        self.rays.text = "".join(marks) + LEFT * (RAYS - rays)

    def clear(self) -> None:
        """Nothing was felt yet, or nobody plays here."""
        self.scene.content = ""
        self.score.text = self.rays.text = self.about.text = ""

    def focus(self) -> None:
        """Let keys go here."""
        ui.run_javascript(f"getHtmlElement({self.surface.id}).focus({{preventScroll: true}})")

    def listen(self, press: Told, move: Told, release: Told, key: Key) -> None:
        """Take part in the game: pointer places are shares (down, right) of the picture, 0–1."""

        def place(told: Told) -> Callable[[events.GenericEventArguments], Awaitable[None] | None]:
            return lambda event: told((float(event.args[0]), float(event.args[1])))

        self.surface.props('tabindex=0 role=application aria-label="Your rays"').classes("yours")
        self.surface.on("pointerdown", place(press), js_handler=WHERE)
        self.surface.on("pointermove", place(move), js_handler=WHERE, throttle=BETWEEN_MOVES)
        self.surface.on("pointerup", place(release), js_handler=WHERE)
        self.surface.on("keydown", lambda event: key(*event.args), js_handler=PRESSED)


def mark(step: Step) -> str:
    """A ray in a sign."""
    return "✕" if step.touch is None else "◐" if step.repeated else "●"
