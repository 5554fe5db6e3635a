"""Collecting meshes, and HTTP servers on loopback to fetch them from: Python's own, and one with
ranges that can break off."""

import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from http.server import BaseHTTPRequestHandler, SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pandas as pd
import pytest
from upath import UPath

from tactile_core.dataset.meshes import collect_meshes
from tactile_core.settings import MeshSettings
from tests.core.dataset.mesh_files import ONE


@pytest.fixture(autouse=True)
def no_proxy_and_no_token(monkeypatch):
    """Loopback is reached directly, and a developer's own token stays out of the tests."""
    monkeypatch.setenv("NO_PROXY", "127.0.0.1,localhost")
    monkeypatch.delenv("HF_TOKEN", raising=False)


@pytest.fixture
def collect(tmp_path):
    """Collect into `tmp_path/root`; the location is `tmp_path/source` unless another is given."""

    def run(classes=ONE, location=tmp_path / "source", root=None, **options) -> pd.DataFrame:
        wanted = MeshSettings(
            classes=classes, location=None if location is None else str(location), **options
        )
        return collect_meshes(wanted, root or UPath(tmp_path / "root"), tmp_path / "cache")

    return run


@pytest.fixture
def root(tmp_path) -> UPath:
    return UPath(tmp_path / "root")


def run(server: ThreadingHTTPServer) -> Iterator[ThreadingHTTPServer]:
    thread = threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True)
    thread.start()
    yield server
    server.shutdown()
    thread.join()
    server.server_close()


@dataclass
class Site:
    """What `python -m http.server` serves, and what it was asked: (method, path, status)."""

    folder: Path
    url: str
    log: list[tuple[str, str, int]]


@pytest.fixture
def site(tmp_path) -> Iterator[Site]:
    """The handler behind `python -m http.server`: Last-Modified, no ETag, no ranges."""
    folder = tmp_path / "site"
    folder.mkdir()
    log: list[tuple[str, str, int]] = []

    class Handler(SimpleHTTPRequestHandler):
        def log_request(self, code="-", size="-"):
            log.append((self.command, self.path, int(code)))

        def log_message(self, format, *args):
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Handler, directory=str(folder)))
    for running in run(server):
        yield Site(folder, f"http://127.0.0.1:{running.server_port}", log)


@dataclass
class Store:
    """A server of one file: what it holds, how it misbehaves, and what it was asked."""

    url: str = ""
    body: bytes = b""
    etag: str | None = '"1"'
    modified: str | None = None
    ranges: bool = True
    conditions: bool = True
    knows_if_range: bool = True
    length: str | None = None  # instead of the true Content-Length
    status: list[int] = field(default_factory=list)  # refusals, one per request to come
    breaks: list[int] = field(default_factory=list)  # bytes sent before the line is cut
    head: int = 200  # the answer to HEAD
    redirect: str | None = None
    retry_after: str | None = None
    requests: list[tuple[str, dict[str, str]]] = field(default_factory=list)
    sent: int = 0


def store_handler(store: Store) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def log_message(self, format, *args):
            pass

        def answer(self, status: int, **headers: str) -> None:
            self.send_response(status)
            for name, value in headers.items():
                self.send_header(name.replace("_", "-"), value)
            if store.etag:
                self.send_header("ETag", store.etag)
            if store.modified:
                self.send_header("Last-Modified", store.modified)
            self.send_header("Connection", "close")
            self.end_headers()

        def do_HEAD(self):
            store.requests.append(("HEAD", dict(self.headers)))
            self.answer(store.head, Content_Length=str(len(store.body)))

        def do_GET(self):
            store.requests.append(("GET", dict(self.headers)))
            if store.redirect:
                return self.answer(302, Location=store.redirect, Content_Length="0")
            if store.status:
                more = {"Retry_After": store.retry_after} if store.retry_after else {}
                return self.answer(store.status.pop(0), Content_Length="0", **more)
            asked = self.headers.get("If-None-Match")
            if store.conditions and store.etag and asked == store.etag:
                return self.answer(304)
            wanted = self.headers.get("Range")
            start = 0
            same = self.headers.get("If-Range") == store.etag or not store.knows_if_range
            if wanted and store.ranges and same:
                start = int(wanted.removeprefix("bytes=").removesuffix("-"))
                if start >= len(store.body):
                    return self.answer(416, Content_Length="0")
                span = f"bytes {start}-{len(store.body) - 1}/{len(store.body)}"
                length = str(len(store.body) - start)
                self.answer(206, Content_Length=length, Content_Range=span)
            else:
                self.answer(200, Content_Length=store.length or str(len(store.body)))
            rest = store.body[start:]
            if store.breaks:
                rest = rest[: store.breaks.pop(0)]
            store.sent += len(rest)
            self.wfile.write(rest)

    return Handler


@pytest.fixture
def make_store() -> Iterator:
    """Start servers with `make_store(body=..., ...)`; each runs until the test ends."""
    running = []

    def start(**settings) -> Store:
        store = Store(**settings)
        server = ThreadingHTTPServer(("127.0.0.1", 0), store_handler(store))
        store.url = f"http://127.0.0.1:{server.server_port}/03797390.zip"
        running.append(run(server))
        next(running[-1])
        return store

    yield start
    for server in running:
        next(server, None)
