"""The figures that the web interface serves beside Dagster's pages, and nothing else."""

import http.client
import io
import socket
import threading
from collections.abc import Iterator

import fsspec
import pytest
import uvicorn
from PIL import Image
from starlette.applications import Starlette
from starlette.routing import Route

from tactile_assets.webserver import figure
from tactile_core.files import content_hash


@pytest.fixture(scope="module")
def port() -> Iterator[int]:
    """Of a server on loopback with the route of figures alone."""
    app = Starlette(routes=[Route("/figures/{name}", figure)])
    with socket.create_server(("127.0.0.1", 0)) as listening:
        server = uvicorn.Server(uvicorn.Config(app, log_level="critical", lifespan="off"))
        thread = threading.Thread(target=server.run, args=([listening],))
        thread.start()
        yield listening.getsockname()[1]
        server.should_exit = True
        thread.join()


@pytest.fixture
def get(port, tmp_path, monkeypatch):
    """Ask for a path, letter by letter as given, of a store that holds more than figures."""
    monkeypatch.setenv("TACTILE_HOME", str(tmp_path))
    monkeypatch.delenv("DAGSTER_HOME", raising=False)
    monkeypatch.delenv("TACTILE_STORE", raising=False)
    figures = tmp_path / "artifacts" / "figures"
    figures.mkdir(parents=True)
    Image.new("RGB", (900, 300), "white").save(figures / "wide.png")
    (figures / "run.gif").write_bytes(b"GIF89a")
    (figures / "note.txt").write_text("secret")
    (tmp_path / "artifacts" / "secret.png").write_bytes(b"secret")

    def ask(path: str) -> tuple[int, str, bytes]:
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=20)
        connection.request("GET", path)
        answer = connection.getresponse()
        return answer.status, answer.headers["content-type"], answer.read()

    return ask


def test_a_figure_is_served_whole_and_small(get, tmp_path):
    whole = (tmp_path / "artifacts" / "figures" / "wide.png").read_bytes()
    assert get("/figures/wide.png") == (200, "image/png", whole)
    assert Image.open(io.BytesIO(get("/figures/wide.png?small")[2])).size == (420, 140)
    assert get("/figures/run.gif?small") == (200, "image/gif", b"GIF89a")


def test_a_figure_is_not_found_once_another_has_taken_its_place(get, tmp_path):
    path = tmp_path / "artifacts" / "figures" / "wide.png"
    address = f"/figures/wide.png?version={content_hash(path.read_bytes())}"
    assert get(address)[0] == 200
    Image.new("RGB", (900, 300), "black").save(path)
    assert get(address)[0] == 404
    assert get("/figures/wide.png")[0] == 200


@pytest.mark.parametrize(
    "name",
    ["missing.png", "note.txt", "../secret.png", "..%2Fsecret.png", "%2e%2e%2fsecret.png",
     "..%5Csecret.png", "wide.png%00", "wide.png%0A", ".png", "", "%2Fetc%2Fpasswd"],
)  # fmt: skip
def test_nothing_but_figures_is_served(get, name):
    status, _, content = get(f"/figures/{name}")
    assert status == 404 and b"secret" not in content


def test_figures_come_from_an_object_store_too(get, monkeypatch):
    with fsspec.open("memory://bucket/figures/far.gif", "wb") as file:
        file.write(b"GIF89a")
    monkeypatch.setenv("TACTILE_STORE", "memory://bucket")
    assert get("/figures/far.gif")[2] == b"GIF89a"
    assert get("/figures/run.gif")[0] == 404
