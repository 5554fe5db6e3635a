"""Dagster's web interface, with the figures of the store beside it: `/figures/masks.png`.

With `?small` a picture is as wide as a page of the interface has room for; with `?version=…` it is
found only while it is the one that was meant.

`python -m tactile_assets.webserver` takes the options of `dagster-webserver`.
"""

import io
import re

import dagster_webserver.app
import dagster_webserver.cli
from dagster_webserver.webserver import DagsterWebserver
from PIL import Image
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import BaseRoute, Route

from tactile_assets.resources import FIGURES, Store
from tactile_core.errors import OutOfReachError
from tactile_core.files import content_hash, stored_bytes

WIDTH = 420  # pixels
KINDS = {"png": "image/png", "gif": "image/gif"}
NAME = re.compile(rf"[\w-]+\.({'|'.join(KINDS)})", re.ASCII)  # no path leads out of the folder


class WebserverWithFigures(DagsterWebserver):
    """Dagster's own, which hands what is none of our figures to its pages."""

    def build_routes(self) -> list[BaseRoute]:
        return [Route(f"/{FIGURES}/{{name}}", figure), *super().build_routes()]


def figure(request: Request) -> Response:
    """A figure of the store."""
    name = NAME.fullmatch(request.path_params["name"])
    try:
        picture = name and stored_bytes(Store.from_environment().path(FIGURES, name[0]))
    except OutOfReachError as error:
        return PlainTextResponse(str(error), status_code=503)
    except OSError:
        picture = None
    if not name or not picture:
        return PlainTextResponse("There is no such figure.", status_code=404)
    asked = request.query_params
    if asked.get("version") not in (None, content_hash(picture)):
        return PlainTextResponse("A later run has replaced this figure.", status_code=404)
    if "small" in asked and name[1] == "png":
        picture = small(picture)
    return Response(picture, media_type=KINDS[name[1]])


def small(png: bytes) -> bytes:
    """A picture that fits in the width of the metadata's table."""
    image = Image.open(io.BytesIO(png)).convert("RGB")
    image.thumbnail((WIDTH, image.height), Image.Resampling.LANCZOS)
    file = io.BytesIO()
    image.save(file, format="PNG")
    return file.getvalue()


def main() -> None:
    dagster_webserver.app.DagsterWebserver = WebserverWithFigures  # type: ignore[misc]
    dagster_webserver.cli.main()


if __name__ == "__main__":
    main()
