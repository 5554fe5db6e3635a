"""The page: every visit has a game of its own, and shares nothing with any other."""

import asyncio
from collections.abc import Callable

import numpy as np
from nicegui import background_tasks, events, ui

from tactile_core.dataset.things import Thing
from tactile_core.errors import TactileError
from tactile_core.play.aim import Aim, Place, Ray
from tactile_core.play.board import NEW_GAME
from tactile_core.play.drawing import Drawing
from tactile_core.play.game import Game, Hand, Opponent
from tactile_core.play.hidden import Maker, brought, drawn
from tactile_core.play.materials import Materials
from tactile_core.play.scene import place_at
from tactile_core.play.view import LARGEST_FILE, NOBODY, TOO_LARGE, View
from tactile_core.play.workers import Workers, on

OWN = DRAWN, BROUGHT = "one that you draw", "a file of yours"


class Table:
    """One visit: the game that is played, told to what shows it."""

    def __init__(self, materials: Materials, makers: dict[str, Maker], workers: Workers) -> None:
        self.materials = materials
        self.makers = makers
        self.workers = workers
        self.rng = np.random.default_rng()
        self.aim = Aim(materials.resolution)
        self.drawing: Drawing | None = None
        self.game: Game | None = None
        self.casting = False
        self.view = View(self, [*makers, *OWN], [*materials.opponents, NOBODY])

    # A new game

    async def new_game(self) -> None:
        self.game = None
        self.aim.drop()
        self.drawing = (
            Drawing(self.materials.resolution) if self.view.shape.value == DRAWN else None
        )
        if self.drawing:
            self.view.words.text = (
                "Draw its outline, a loop within it is a hole; then hide it. New game begins anew."
            )
            self.show()
            return
        if self.view.shape.value == BROUGHT:
            self.view.words.text = "Bring a mesh or a picture of your own."
            self.show()
            self.view.files.open()
            return
        self.begin(
            await on(self.workers.players, self.makers[str(self.view.shape.value)], self.rng)
        )

    def begin(self, thing: Thing) -> None:
        """Hide it and start."""
        policy = self.materials.opponents.get(str(self.view.against.value))
        seed = int(self.rng.integers(2**31))
        opponent = Opponent(thing.mask, self.materials.thinker, policy, seed) if policy else None
        self.game = Game(
            thing.mask, thing.said, Hand(thing.mask, self.materials.reconstructor), opponent
        )
        self.drawing = None
        self.view.words.text = "Press on the circle where your first ray starts, and drag."
        self.show()
        self.view.yours.focus()
        if opponent:
            background_tasks.create(self.think(self.game, opponent))

    async def other_opponent(self) -> None:
        if self.game and self.view.shape.value in OWN:
            self.begin(Thing(self.game.mask, self.game.what))
        elif self.game:
            await self.new_game()

    async def think(self, game: Game, opponent: Opponent) -> None:
        """The opponent casts ahead, until another game has begun."""
        while opponent.left and game is self.game and not self.view.words.is_deleted:
            await on(self.workers.opponents, opponent.think)
            if game is self.game and len(opponent.steps) <= len(game.you.steps):
                self.view.show_answers(game)

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
        self.view.files.close()
        self.begin(thing)

    # Rays

    def press(self, share: Place) -> None:
        target = self.drawing or self.playing
        if target:
            target.press(place_at(share, self.aim.resolution))
            self.view.show_pointer(self.pointer)

    def move(self, share: Place) -> None:
        target = self.drawing or self.playing
        if target:
            target.move(place_at(share, self.aim.resolution))
            self.view.show_pointer(self.pointer)

    async def release(self, share: Place) -> None:
        if self.drawing:
            self.drawing.release()
        elif self.playing and (ray := self.aim.release(place_at(share, self.aim.resolution))):
            await self.cast(ray)
        self.view.show_pointer(self.pointer)

    async def key(self, name: str, shift: bool) -> None:
        if name in NEW_GAME:
            await self.new_game()
        elif self.playing and (ray := self.aim.key(name, shift)):
            await self.cast(ray)
        self.view.show_pointer(self.pointer)

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

    @property
    def pointer(self) -> Aim | Drawing:
        """What the mouse moves."""
        return self.drawing or self.aim

    def show(self) -> None:
        self.view.show(self.game, self.pointer)
