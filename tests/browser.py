"""A real browser for tests of pages: Debian's Chromium, driven by Playwright.

Where there is none the tests are skipped; under `.ci/run`, which sets CI, they fail.
"""

import math
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from playwright.sync_api import Page, expect, sync_playwright

WIDTH, HEIGHT = 1440, 1000
PATIENCE = 120_000  # milliseconds: a page may be slow on a busy machine


@contextmanager
def browser_page() -> Iterator[Page]:
    """A page of a browser of its own."""
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    if not chromium:
        assert "CI" not in os.environ, "there is no Chromium"
        pytest.skip("there is no Chromium (Debian: apt install chromium)")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        page = browser.new_page(
            viewport={"width": WIDTH, "height": HEIGHT},
            device_scale_factor=2,  # small writing stays legible in pictures of a page
        )
        page.set_default_timeout(PATIENCE)
        expect.set_options(timeout=PATIENCE)
        yield page
        browser.close()


def drag(page: Page, angle: float, aside: float = 0.0) -> None:
    """In the game, a ray from the circle at `angle` to the other side, `aside` radians off it."""
    box = page.locator(".you .surface").bounding_box()
    assert box is not None

    def at(angle: float) -> tuple[float, float]:
        right, down = 0.46 * math.sin(angle), 0.46 * math.cos(angle)
        return box["x"] + box["width"] * (0.5 + right), box["y"] + box["height"] * (0.5 + down)

    page.mouse.move(*at(angle))
    page.mouse.down()
    page.mouse.move(*at(angle + math.pi + aside), steps=3)
    page.mouse.up()
