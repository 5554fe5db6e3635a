"""The game as people meet it, in a real browser."""

import re
import urllib.error
import urllib.request

import pytest
from playwright.sync_api import Page, expect

from tests.browser import drag


def play(page: Page, rays: int) -> None:
    """So many rays, one after the other, turned by the golden ratio; each seventh misses."""
    for number in range(1, rays + 1):
        drag(page, 2.4 * number, aside=2.0 if number % 7 == 0 else 0.0)
        expect(page.locator(".said")).to_contain_text(re.compile(rf"^Ray {number} "))


def signs(page: Page, who: str, kind: str) -> int:
    return page.locator(f".{who} .{kind}").count()


def choose(page: Page, label: str, option: str) -> None:
    page.get_by_label(label).click()
    page.get_by_role("option", name=option, exact=True).click()


def test_a_whole_game_against_a_policy_with_the_mouse(page):
    assert signs(page, "you", "touch") == 0
    play(page, 7)
    assert signs(page, "you", "touch") + signs(page, "you", "miss") == 7
    assert signs(page, "you", "miss") >= 1
    expect(page.locator(".opponent .touch")).not_to_have_count(0)  # it thinks for a while
    assert signs(page, "opponent", "touch") <= 7  # it may miss, or meet a touch again
    assert signs(page, "you", "truth") == signs(page, "opponent", "truth") == 0
    for number in (8, 9, 10):
        drag(page, 2.4 * number)
        expect(page.locator(".said")).to_contain_text(re.compile(rf"^Ray {number} "))
    expect(page.locator(".said")).to_contain_text(
        re.compile(r"It was \w+ \d+ of the test split\. You reached [\d.]+, recall [\d.]+: ")
    )
    assert signs(page, "you", "truth") == signs(page, "opponent", "truth") == 2
    assert page.locator(".opponent .title").inner_text() == "recall"
    curves = page.evaluate(CURVES)
    assert [curve["name"] for curve in curves] == ["you", "recall"]
    assert [len(curve["data"]) for curve in curves] == [11, 11]
    assert all(0 <= index <= 100 for curve in curves for _, index in curve["data"])
    drag(page, 1.0)
    page.get_by_role("button", name="New game").click()
    expect(page.locator(".you .ray")).to_have_count(0)
    expect(page.locator(".you .truth")).to_have_count(0)


# What the chart on the page was given.
CURVES = """() => {
  const chart = document.querySelector('.chart');
  return getElement(parseInt(chart.id.substring(1))).chart.getOption().series;
}"""


def test_a_game_with_keys_and_nobody_against(page):
    choose(page, "play against", "nobody")
    expect(page.locator(".opponent .ray")).to_have_count(0)
    page.locator(".you .surface").focus()
    page.keyboard.press("ArrowLeft")
    expect(page.locator(".you .aim")).to_have_count(1)
    for number in range(1, 11):
        page.keyboard.press("Shift+ArrowLeft")
        page.keyboard.press("Enter")
        expect(page.locator(".said")).to_contain_text(re.compile(rf"^Ray {number} "))
    expect(page.locator(".said")).to_contain_text(re.compile(r"You reached [\d.]+\.$"))
    page.keyboard.press("n")
    expect(page.locator(".you .ray")).to_have_count(0)


def test_two_tabs_play_two_games(page, browser, address):
    other = browser.new_page(viewport={"width": 390, "height": 844})
    other.goto(address)
    other.wait_for_selector(".you svg circle")
    play(page, 2)
    play(other, 1)
    drag(page, 7.2)
    expect(page.locator(".said")).to_contain_text(re.compile("^Ray 3 "))
    assert signs(other, "you", "touch") + signs(other, "you", "miss") == 1
    assert other.evaluate("document.documentElement.scrollWidth") <= 390
    other.close()


def test_a_drawn_shape_is_hidden_and_felt(page):
    choose(page, "hidden shape", "one that you draw")
    page.get_by_role("button", name="Hide it and play").click()
    expect(page.get_by_text("There is no shape yet")).to_be_visible()
    box = page.locator(".you .surface").bounding_box()
    corners = [(0.3, 0.4), (0.7, 0.4), (0.7, 0.6), (0.3, 0.6)]
    places = [(box["x"] + x * box["width"], box["y"] + y * box["height"]) for x, y in corners]
    page.mouse.move(*places[0])
    page.mouse.down()
    for place in places[1:]:
        page.mouse.move(*place)
        page.wait_for_timeout(60)  # the page is told of a move every now and then
    page.mouse.up()
    page.get_by_role("button", name="Hide it and play").click()
    expect(page.get_by_role("button", name="Hide it and play")).to_be_hidden()
    play(page, 3)
    assert signs(page, "you", "touch") == 3


def test_a_file_is_hidden_or_refused_in_a_sentence(page, tmp_path):
    choose(page, "hidden shape", "a file of yours")
    page.locator("input[type=file]").set_input_files(
        {"name": "<b>x.obj", "mimeType": "text/plain", "buffer": b"v 0 0 0"}
    )
    expect(page.get_by_text("<b>x.obj has no faces")).to_be_visible()
    square = b"P1 8 8\n" + b"\n".join(
        b"0 0 0 0 0 0 0 0" if row in (0, 7) else b"0 0 1 1 1 1 0 0" for row in range(8)
    )
    page.locator("input[type=file]").set_input_files(
        {"name": "square.pbm", "mimeType": "image/x-portable-bitmap", "buffer": square}
    )
    expect(page.get_by_role("dialog")).to_be_hidden()
    play(page, 1)


@pytest.mark.parametrize("host", ["elsewhere.example", "0.0.0.0"])
def test_a_page_elsewhere_that_resolves_to_this_machine_gets_no_game(address, host):
    request = urllib.request.Request(address, headers={"Host": host})
    with pytest.raises(urllib.error.HTTPError, match="400"):
        urllib.request.urlopen(request, timeout=10)
