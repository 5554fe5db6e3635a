"""`tactile play`: feel out a hidden shape yourself, in the browser."""

import os
import sys
import webbrowser

import click

from tactile_core.errors import TactileError


@click.command()
@click.option(
    "--port", type=click.IntRange(0, 65535), default=8080, show_default=True,
    help="Of the page, on this machine alone; 0 takes any that is free.",
)  # fmt: skip
@click.option("--open/--no-open", "opens", default=True, help="Open the page in the browser.")
def play(port: int, opens: bool) -> None:
    """Feel out a hidden shape with ten rays of your own, against a policy, in the browser."""
    try:
        from tactile_core.play.server import serve
    except ImportError as error:
        raise TactileError(
            f"the page needs NiceGUI ({error}): pip install 'tactile-exploration[play]'"
        ) from error
    from tactile_core.play.materials import gather

    def ready(address: str) -> None:
        click.echo(f"Play at {address} (Ctrl-C ends it)")
        if opens and has_desktop():
            webbrowser.open(address)

    serve(gather(), port, ready)


def has_desktop() -> bool:
    """Whether a browser would open a window; without one, it may take the terminal."""
    return sys.platform != "linux" or bool({"DISPLAY", "WAYLAND_DISPLAY"} & set(os.environ))
