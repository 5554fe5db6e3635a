"""What is on the page of one visit, and how it shows a game."""

from collections.abc import Awaitable, Callable
from typing import Protocol

from nicegui import events, ui

from tactile_core.dataset.sources.parsing import READERS
from tactile_core.play.aim import Aim, Place
from tactile_core.play.board import Board
from tactile_core.play.chart import draw_curves, empty_chart
from tactile_core.play.drawing import Drawing
from tactile_core.play.game import Game, outcome, told
from tactile_core.play.legend import legend
from tactile_core.play.materials import OPPONENTS
from tactile_core.play.scene import aim_svg, drawing_svg

NOBODY = "nobody"
LARGEST_FILE = 32 << 20  # bytes
TOO_LARGE = f"Files of up to {LARGEST_FILE >> 20} MiB are taken"


class Visitor(Protocol):
    """Who is told what was done on the page; places are shares (down, right) of a picture."""

    async def new_game(self) -> None: ...
    async def other_opponent(self) -> None: ...
    async def hide_drawing(self) -> None: ...
    async def hide_file(self, uploaded: events.UploadEventArguments) -> None: ...
    def press(self, share: Place) -> None: ...
    def move(self, share: Place) -> None: ...
    async def release(self, share: Place) -> None: ...
    async def key(self, name: str, shift: bool) -> None: ...


class View:
    """Everything on the page; it knows of no game but the one that it is told to show."""

    def __init__(self, visitor: Visitor, shapes: list[str], opponents: list[str]) -> None:
        with ui.element("div").classes("play"):
            with ui.element("div").classes("bar"):
                ui.html("Feel out a hidden shape with ten rays", tag="h1")
                self.shape = choice("hidden shape", shapes, visitor.new_game)
                self.against = choice("play against", opponents, visitor.other_opponent)
                self.files = file_dialog(visitor)
                self.hide = ui.button("Hide it and play", on_click=visitor.hide_drawing)
                self.hide.props("unelevated no-caps color=accent")
                ui.button("New game", on_click=visitor.new_game).props("unelevated no-caps")
            self.words = ui.label().classes("said").props("role=status aria-live=polite")
            self.yours = Board("You", "you")
            self.yours.listen(visitor.press, visitor.move, visitor.release, visitor.key)
            self.theirs = Board("", "opponent")
            with ui.element("aside").classes("side"):
                with ui.element("div"):
                    ui.label("Jaccard index, ray by ray").classes("title")
                    self.chart = empty_chart()
                with ui.element("div"):
                    legend()

    def show(self, game: Game | None, pointer: Aim | Drawing) -> None:
        """Everything as it stands."""
        self.hide.visible = isinstance(pointer, Drawing)
        self.show_pointer(pointer)
        if game is None:
            self.yours.clear()
            self.theirs.clear()
            draw_curves(self.chart, {})
            return
        rays = len(game.you.steps)
        if rays:
            self.words.text = told(game.you)
        self.yours.show(game.you, rays, game.mask if game.over else None)
        self.show_answers(game)

    def show_answers(self, game: Game) -> None:
        """The opponent's rays, as many as yours, both curves, and how it ended."""
        curves = {"you": game.you.curve(len(game.you.steps))}
        if game.opponent:
            rays = min(len(game.opponent.steps), len(game.you.steps))
            self.theirs.title.text = game.opponent.policy.name
            self.theirs.about.text = OPPONENTS[game.opponent.policy.name]
            self.theirs.show(game.opponent, rays, game.mask if game.over else None)
            curves[game.opponent.policy.name] = game.opponent.curve(rays)
        else:
            self.theirs.title.text = NOBODY
            self.theirs.clear()
        draw_curves(self.chart, curves)
        if game.over:
            self.words.text = f"{told(game.you)} {outcome(game)}"

    def show_pointer(self, pointer: Aim | Drawing) -> None:
        self.yours.overlay.content = (
            drawing_svg(pointer) if isinstance(pointer, Drawing) else aim_svg(pointer)
        )


def choice(label: str, options: list[str], changed: Callable[[], Awaitable[None]]) -> ui.select:
    chosen = ui.select(options, value=options[0], label=label, on_change=changed)
    return chosen.props("outlined dense options-dense")


def file_dialog(visitor: Visitor) -> ui.dialog:
    with ui.dialog() as dialog, ui.card():
        ui.label(f"A mesh ({' '.join(READERS)}) or a black-and-white picture")
        ui.upload(
            label="it stays on this machine", auto_upload=True, on_upload=visitor.hide_file,
            max_file_size=LARGEST_FILE,
            on_rejected=lambda: ui.notify(TOO_LARGE, type="warning"),
        ).props("flat bordered")  # fmt: skip
    return dialog
