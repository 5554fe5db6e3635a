"""A server of the game on loopback, and a browser."""

import os
import re
import subprocess
import sys
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Page

from tests.browser import PATIENCE, browser_page


@pytest.fixture(scope="module")
def address(tmp_path_factory) -> Iterator[str]:
    """Where `tactile play` says that it is; its home is empty, so it plays with what is shipped."""
    home = tmp_path_factory.mktemp("home")
    command = [sys.executable, "-m", "tactile_core", "play", "--port", "0", "--no-open"]
    # NiceGUI behaves otherwise where it believes itself under test.
    environ = {name: value for name, value in os.environ.items() if "PYTEST" not in name}
    environ |= {"TACTILE_HOME": str(home), "PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(command, env=environ, stdout=subprocess.PIPE, text=True) as server:
        try:
            assert server.stdout is not None
            said = server.stdout.readline()
            found = re.search(r"http://127\.0\.0\.1:\d+", said)
            assert found, said
            yield found[0]
        finally:
            server.terminate()


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with browser_page() as page:
        assert page.context.browser is not None
        yield page.context.browser


@pytest.fixture
def page(browser, address) -> Iterator[Page]:
    """A game that has begun; nothing but this machine is asked, and no script fails."""
    page = browser.new_page(viewport={"width": 1280, "height": 800})
    page.set_default_timeout(PATIENCE)
    asked: list[str] = []
    failed: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.on("pageerror", lambda error: failed.append(str(error)))
    page.goto(address)
    page.wait_for_selector(".you svg circle")
    yield page
    page.close()
    assert not failed
    assert [url for url in asked if not url.startswith((address, "data:", f"blob:{address}"))] == []
