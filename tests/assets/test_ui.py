"""What a user sees of a finished run in a real browser, on the pages that `make ui` starts.

`TACTILE_SCREENSHOTS=docs pytest tests/assets/test_ui.py` keeps pictures of the pages as docs/*.png;
with TACTILE_SCREENSHOTS_OF=<home> they show a copy of that home in place of the tiny test run.
"""

import os
import re
import signal
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Page, Response, expect

from tactile_assets.paths import REPOSITORY
from tests.assets.running import ALL, plain
from tests.browser import browser_page
from tests.shared import copied

ASSETS = "/assets"
MARGIN = 12  # pixels
LAUNCHPAD = "/locations/tactile-exploration/jobs/dataset/playground"


@pytest.fixture(scope="module")
def pages(home, finished, tmp_path_factory) -> Iterator[dict[str, str]]:
    """The addresses that the command of `make ui` prints, by their names, on a copy of the home."""
    copy = tmp_path_factory.mktemp("ui") / "home"
    copied(os.environ.get("TACTILE_SCREENSHOTS_OF", home), copy)
    process = subprocess.Popen(
        ["bash", "-c", ". ./environment.sh && exec python -m tactile_assets.ui"],
        cwd=REPOSITORY,
        env=plain(copy),
        stdout=subprocess.PIPE,
        text=True,
    )
    addresses = {}
    for line in process.stdout:
        name, _, address = line.partition(": ")
        addresses[name] = address.strip()
        if line.startswith("Ctrl-C"):
            break
    assert process.poll() is None
    addresses["site"] = addresses["The graph"].partition("/asset-groups")[0]
    yield addresses
    process.send_signal(signal.SIGTERM)
    assert process.wait(120) == 0


@pytest.fixture(scope="module")
def page() -> Iterator[Page]:
    with browser_page() as page:
        yield page


@pytest.fixture
def keep(page) -> Callable[..., None]:
    """Keep a picture of what the page shows, where pictures were asked for: all of it, or the
    rectangle `around` what that selector finds."""

    def screenshot(name: str, around: str | None = None) -> None:
        if folder := os.environ.get("TACTILE_SCREENSHOTS"):
            page.screenshot(
                path=Path(folder, f"{name}.png"),
                clip=rectangle(page, around) if around else None,
                style="#zoom-slider-container { display: none }",  # it covers the graph's corner
            )

    return screenshot


def rectangle(page: Page, around: str) -> dict[str, float]:
    boxes = [box for found in page.locator(around).all() if (box := found.bounding_box())]
    left, top = (min(box[side] for box in boxes) - MARGIN for side in ("x", "y"))
    right = max(box["x"] + box["width"] for box in boxes) + MARGIN
    bottom = max(box["y"] + box["height"] for box in boxes) + MARGIN
    return {"x": left, "y": top, "width": right - left, "height": bottom - top}


def test_the_first_page_is_the_whole_graph_and_nothing_in_it_is_stale(page, pages, keep):
    assert "profile smoke, as in the last run here" in pages["Starting"]
    page.goto(pages["The graph"])
    for asset in ALL:
        name = asset if len(asset) < 16 else asset[:6]  # long ones are shortened in the middle
        expect(page.get_by_text(name).first).to_be_visible()
    expect(page.get_by_role("button", name="Materialize all")).to_be_enabled()
    keep("lineage", around="[data-svg-viewport] foreignObject")
    query = {"query": "{ assetNodes { assetKey { path } staleStatus } }"}
    answer = page.request.post(f"{pages['site']}/graphql", data=query).json()
    assert {
        node["assetKey"]["path"][0]: node["staleStatus"] for node in answer["data"]["assetNodes"]
    } == dict.fromkeys(ALL, "FRESH")


@pytest.mark.parametrize(
    ("asset", "shows"),
    [("masks", "masks_by_class"), ("per_step_evaluation", "jaccard_after_each_ray")],
)
def test_an_asset_shows_its_picture_and_numbers_without_a_click(page, pages, keep, asset, shows):
    page.goto(f"{pages['site']}{ASSETS}/{asset}")
    row = page.locator("tr", has=page.get_by_text(shows, exact=True))
    picture = row.locator("img")
    picture.scroll_into_view_if_needed()
    expect(picture).to_be_visible()
    assert picture.evaluate("image => image.complete && image.naturalWidth") == 420
    address = row.get_by_role("link", name="full size").get_attribute("href")
    assert page.request.get(pages["site"] + address).headers["content-type"] == "image/png"
    expect(page.get_by_text("[Show Markdown]")).to_have_count(0)
    keep(asset)


def test_numbers_of_every_policy_are_plotted_over_runs(page, pages, keep):
    page.goto(pages["The results"])
    page.get_by_role("button", name="Plots").click()
    for policy in ("random", "gain", "oracle"):
        expect(page.get_by_text(f"jaccard at ray 10/{policy}", exact=True)).to_be_visible()
    expect(page.locator("canvas").first).to_be_visible()
    keep("plots")


def test_what_make_run_ran_stands_under_its_job_and_in_the_timeline(page, pages):
    page.goto(pages["site"])
    expect(page.get_by_role("link", name="whole_chain").first).to_be_visible()
    page.goto(f"{pages['site']}/locations/tactile-exploration/jobs/whole_chain/runs")
    expect(page.get_by_text("Success").first).to_be_visible()


def test_the_launchpad_refuses_what_is_out_of_bounds_and_what_is_no_choice(page, pages, keep):
    configure(page, pages, "masks: {config: {renderer: brush}}")
    expect(page.get_by_text(re.compile("renderer not in enum type"))).to_be_visible()
    expect(page.get_by_role("button", name="Launch Run")).to_be_disabled()
    configure(page, pages, "masks: {config: {resolution: 65}}")
    page.get_by_role("button", name="Launch Run").click()
    expect(page.get_by_text("resolution = 65: Input should be a multiple of 16")).to_be_visible()
    keep("launchpad")
    page.goto(f"{pages['site']}/locations/tactile-exploration/jobs/dataset/runs")
    expect(page.get_by_text("No runs", exact=False).first).to_be_visible()


def configure(page: Page, pages: dict[str, str], ops: str) -> None:
    """Write run config for the job `dataset` into the launchpad's editor."""
    page.goto(pages["site"] + LAUNCHPAD)
    editor = page.locator(".CodeMirror")
    expect(editor).to_contain_text("ops")
    editor.evaluate("(editor, text) => editor.CodeMirror.setValue(text)", f"ops: {{{ops}}}")
    expect(editor).to_contain_text(ops)


def test_an_asset_is_materialised_to_its_end(page, pages):
    page.goto(f"{pages['site']}{ASSETS}/outlines")
    with page.expect_response(launches_a_run) as answer:
        page.get_by_role("button", name=re.compile("Materialize$")).click()
    run = answer.value.json()["data"]["launchPipelineExecution"]["run"]["id"]
    page.goto(f"{pages['site']}/runs/{run}")
    expect(page.get_by_text("Success").first).to_be_visible()


def launches_a_run(response: Response) -> bool:
    return "LaunchPipelineExecution" in (response.request.post_data or "")
