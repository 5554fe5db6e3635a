"""How soon `tactile play` answers a ray: `python -m benchmarks.speed_play`, in a real browser.

From the release of the mouse until the page says what the ray met, which it does together with the
new reconstruction; alone, and against each of two opponents that compute meanwhile.
"""

import subprocess
import sys

import pandas as pd
from playwright.sync_api import Page

from benchmarks.machine import describe_machine
from tests.browser import browser_page, drag

GAMES = 5
RAYS = 10
# Notes when the mouse was released, and how long it took until the page said more.
WATCH = """() => {
  window.answers = [];
  const said = () => document.querySelector(".said").textContent;
  let released = null, before = "";
  document.addEventListener("pointerup", () => {
    released = performance.now();
    before = said();
  }, true);
  new MutationObserver(() => {
    if (released !== null && said() !== before && said().startsWith("Ray ")) {
      window.answers.push(performance.now() - released);
      released = null;
    }
  }).observe(document.body, {subtree: true, childList: true, characterData: true});
}"""


def main() -> None:
    command = [sys.executable, "-m", "tactile_core", "play", "--no-open", "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        address = next(line for line in server.stdout if "Play at" in line).split()[2]
        try:
            with browser_page() as page:
                rows = [row for opponent in ("nobody", "recall", "oracle")
                        for row in milliseconds(page, address, opponent)]  # fmt: skip
        finally:
            server.terminate()
    table = pd.DataFrame(rows, columns=["against", "milliseconds"])
    print(describe_machine(0)["cpu"])
    print(table.groupby("against", sort=False)["milliseconds"]
          .describe(percentiles=[0.5, 0.95]).round(0).to_string())  # fmt: skip


def milliseconds(page: Page, address: str, opponent: str) -> list[tuple[str, float]]:
    """How long each ray of some games took, but for the first game's, which warms up."""
    page.goto(address)
    page.wait_for_selector(".you svg circle")
    page.get_by_label("play against").click()
    page.get_by_role("option", name=opponent, exact=True).click()
    page.wait_for_timeout(1000)
    page.evaluate(WATCH)
    for _ in range(GAMES + 1):
        for ray in range(RAYS):
            before = page.evaluate("window.answers.length")
            drag(page, 2.4 * ray)
            page.wait_for_function("before => window.answers.length > before", arg=before)
            page.wait_for_timeout(500)  # as a player who looks at it
        page.get_by_role("button", name="New game").click()
        page.wait_for_function("!document.querySelector('.you .ray')")
    return [(opponent, answer) for answer in page.evaluate("window.answers")[RAYS:]]


if __name__ == "__main__":
    main()
