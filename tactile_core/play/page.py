"""The page: every visit has a game of its own, and shares nothing with any other."""

import asyncio
from collections.abc import Awaitable, Callable

import numpy as np
from nicegui import background_tasks, events, ui

from tactile_core.dataset.sources.parsing import READERS
from tactile_core.dataset.things import Thing
from tactile_core.errors import TactileError
from tactile_core.play.aim import Aim, Place, Ray
from tactile_core.play.board import NEW_GAME, Board
from tactile_core.play.chart import draw_curves, empty_chart
from tactile_core.play.drawing import Drawing
from tactile_core.play.game import Game, Hand, Opponent, outcome, told
from tactile_core.play.hidden import Maker, brought, drawn
from tactile_core.play.legend import legend
from tactile_core.play.materials import OPPONENTS, Materials
from tactile_core.play.scene import aim_svg, drawing_svg, place_at
from tactile_core.play.workers import Workers, on

NOBODY = "nobody"
OWN = DRAWN, BROUGHT = "one that you draw", "a file of yours"
LARGEST_FILE = 32 << 20  # bytes
TOO_LARGE = f"Files of up to {LARGEST_FILE >> 20} MiB are taken"


class Table:
    """One visit: what is on the page, and the game that is played there."""

    def __init__(self, materials: Materials, makers: dict[str, Maker], workers: Workers) -> None:
        self.materials = materials
        self.makers = makers
        self.workers = workers
        self.rng = np.random.default_rng()
        self.aim = Aim(materials.resolution)
        self.drawing: Drawing | None = None
        self.game: Game | None = None
        self.casting = False
        self.lay()

    def lay(self) -> None:
        """Put everything on the page."""
        with ui.element("div").classes("play"):
            with ui.element("div").classes("bar"):
                ui.html("Feel out a hidden shape with ten rays", tag="h1")
                self.shape = choice("hidden shape", [*self.makers, *OWN], self.new_game)
                everybody = [*self.materials.opponents, NOBODY]
                self.against = choice("play against", everybody, self.other_opponent)
                self.files = self.file_dialog()
                self.hide = ui.button("Hide it and play", on_click=self.hide_drawing)
                self.hide.props("unelevated no-caps color=accent")
                ui.button("New game", on_click=self.new_game).props("unelevated no-caps")
            self.words = ui.label().classes("said").props("role=status aria-live=polite")
            self.yours = Board("You", "you")
            self.yours.listen(self.press, self.move, self.release, self.key)
            self.theirs = Board("", "opponent")
            with ui.element("aside").classes("side"):
                with ui.element("div"):
                    ui.label("Jaccard index, ray by ray").classes("title")
                    self.chart = empty_chart()
                with ui.element("div"):
                    legend()

    def file_dialog(self) -> ui.dialog:
        with ui.dialog() as dialog, ui.card():
            ui.label(f"A mesh ({' '.join(READERS)}) or a black-and-white picture")
            ui.upload(
                label="it stays on this machine", auto_upload=True, on_upload=self.hide_file,
                max_file_size=LARGEST_FILE,
                on_rejected=lambda: ui.notify(TOO_LARGE, type="warning"),
            ).props("flat bordered")  # fmt: skip
        return dialog

    # A new game

    async def new_game(self) -> None:
        self.game = None
        self.aim.drop()
        self.drawing = Drawing(self.materials.resolution) if self.shape.value == DRAWN else None
        if self.drawing:
            self.words.text = (
                "Draw its outline, a loop within it is a hole; then hide it. New game begins anew."
            )
            self.show()
            return
        if self.shape.value == BROUGHT:
            self.words.text = "Bring a mesh or a picture of your own."
            self.show()
            self.files.open()
            return
        self.begin(await on(self.workers.players, self.makers[str(self.shape.value)], self.rng))

    def begin(self, thing: Thing) -> None:
        """Hide it and start."""
        policy = self.materials.opponents.get(str(self.against.value))
        seed = int(self.rng.integers(2**31))
        opponent = Opponent(thing.mask, self.materials.thinker, policy, seed) if policy else None
        self.game = Game(
            thing.mask, thing.said, Hand(thing.mask, self.materials.reconstructor), opponent
        )
        self.drawing = None
        self.words.text = "Press on the circle where your first ray starts, and drag."
        self.show()
        self.yours.focus()
        if opponent:
            background_tasks.create(self.think(self.game, opponent))

    async def other_opponent(self) -> None:
        if self.game and self.shape.value in OWN:
            self.begin(Thing(self.game.mask, self.game.what))
        elif self.game:
            await self.new_game()

    async def think(self, game: Game, opponent: Opponent) -> None:
        """The opponent casts ahead, until another game has begun."""
        while opponent.left and game is self.game and not self.words.is_deleted:
            await on(self.workers.opponents, opponent.think)
            if game is self.game and len(opponent.steps) <= len(game.you.steps):
                self.show_answers(game)

    async def hide_drawing(self) -> None:
        if self.drawing:
            await self.hide_own(drawn, self.drawing)

    async def hide_file(self, uploaded: events.UploadEventArguments) -> None:
        if uploaded.file.size() > LARGEST_FILE:
            ui.notify(TOO_LARGE, type="warning")
            return
        await self.hide_own(brought, await uploaded.file.read(), uploaded.file.name)

    async def hide_own(self, make: Callable[..., Thing], *given: object) -> None:
        """Begin with what a player made or brought, or say why not."""
        try:
            thing = await asyncio.to_thread(make, *given, self.materials.resolution)
        except TactileError as error:
            ui.notify(str(error), type="warning", multi_line=True)
            return
        self.files.close()
        self.begin(thing)

    # Rays

    def press(self, share: Place) -> None:
        target = self.drawing or self.playing
        if target:
            target.press(place_at(share, self.aim.resolution))
            self.show_pointer()

    def move(self, share: Place) -> None:
        target = self.drawing or self.playing
        if target:
            target.move(place_at(share, self.aim.resolution))
            self.show_pointer()

    async def release(self, share: Place) -> None:
        if self.drawing:
            self.drawing.release()
        elif self.playing and (ray := self.aim.release(place_at(share, self.aim.resolution))):
            await self.cast(ray)
        self.show_pointer()

    async def key(self, name: str, shift: bool) -> None:
        if name in NEW_GAME:
            await self.new_game()
        elif self.playing and (ray := self.aim.key(name, shift)):
            await self.cast(ray)
        self.show_pointer()

    async def cast(self, ray: Ray) -> None:
        game = self.game
        if game is None or self.casting:
            return
        self.casting = True
        try:
            await on(self.workers.players, game.you.cast, ray)
        finally:
            self.casting = False
        if game is self.game:
            if game.over:
                self.aim.drop()
            self.show()

    @property
    def playing(self) -> Aim | None:
        """What the next ray is aimed with, while there is one."""
        return self.aim if self.game and not self.game.over else None

    # What is seen

    def show(self) -> None:
        """Everything as it stands."""
        self.hide.visible = self.drawing is not None
        self.show_pointer()
        if self.game is None:
            self.yours.clear()
            self.theirs.clear()
            draw_curves(self.chart, {})
            return
        game = self.game
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

    def show_pointer(self) -> None:
        over = drawing_svg(self.drawing) if self.drawing else aim_svg(self.aim)
        self.yours.overlay.content = over


def choice(label: str, options: list[str], changed: Callable[[], Awaitable[None]]) -> ui.select:
    chosen = ui.select(options, value=options[0], label=label, on_change=changed)
    return chosen.props("outlined dense options-dense")
