"""The game's server: on loopback only, for whoever sits at this machine."""

import socket
import warnings
from collections.abc import Callable
from pathlib import Path

import uvicorn
from fastapi import FastAPI
from nicegui import ui
from starlette.middleware.trustedhost import TrustedHostMiddleware

from tactile_core.errors import TactileError
from tactile_core.play.hidden import hiding_places
from tactile_core.play.materials import Materials
from tactile_core.play.page import Table
from tactile_core.play.workers import Workers
from tactile_core.threads import one_thread

LOOPBACK = "127.0.0.1"
STYLE = Path(__file__).with_name("play.css")


def serve(materials: Materials, port: int, ready: Callable[[str], None]) -> None:
    """Serve the game until it is interrupted; `ready` is told its address.

    port : 0 takes any that is free. Raises `TactileError` where it is taken.
    """
    workers = Workers()
    makers = hiding_places(materials.shapes, materials.resolution)

    @ui.page("/", title="Tactile play", response_timeout=60)
    async def page() -> None:
        ui.add_css(STYLE.read_text())
        ui.colors(primary="#0072b2", accent="#7b2d8b")
        table = Table(materials, makers, workers)
        await table.new_game()

    server = FastAPI(openapi_url=None)
    # A page elsewhere whose name resolves to this machine is no page of ours.
    server.add_middleware(TrustedHostMiddleware, allowed_hosts=[LOOPBACK, "localhost"])
    ui.run_with(server, show_welcome_message=False, favicon="✋")
    with listening(port) as taken, one_thread(), warnings.catch_warnings():
        # NiceGUI looks for its server among all objects, and wakes what PyTorch deprecates.
        warnings.filterwarnings("ignore", category=FutureWarning, module="nicegui")
        ready(f"http://{LOOPBACK}:{taken.getsockname()[1]}")
        uvicorn.Server(uvicorn.Config(server, log_level="warning")).run(sockets=[taken])


def listening(port: int) -> socket.socket:
    """A socket on loopback."""
    try:
        return socket.create_server((LOOPBACK, port))
    except OSError as error:
        raise TactileError(f"port {port} is taken ({error.strerror}): name another") from error
