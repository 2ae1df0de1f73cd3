"""Pages in a real browser: fixtures that open them, what tests wait for, and what they click."""

import json
import os
import shutil
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from conftest import write_dive
from mapping_scene import CONFIG, PAIR, flat_frame, track, write_run
from playwright.sync_api import (
    Browser,
    BrowserContext,
    FloatRect,
    Locator,
    Page,
    expect,
    sync_playwright,
)

from stereo_seecolor.commands.fuse import fuse
from stereo_seecolor.commands.report import report
from stereo_seecolor.commands.run import run
from stereo_seecolor.config import RunConfig
from stereo_seecolor.config.file import load_config
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.files.tum import write_tum
from stereo_seecolor.records import SurveyFrame
from stereo_seecolor.report.map_mesh import MeshSizes

CHROMIUM = (
    os.environ.get("CHROMIUM")
    or shutil.which("chromium")
    or shutil.which("chromium-browser")
    or shutil.which("google-chrome")
)
NASTY = "<img src=x onerror=document.title='fooled'>"
FLAT_BGR = np.array([40, 120, 200])
SOFTWARE = (
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-gpu-compositing",
)
"""No graphics card, which is imitated for the map alone, and tests in a container run as root."""
SHOWN = {
    "overview": ".verdict",
    "frames": ".stage img",
    "plots": ".plot canvas",
    "map": ".map-stage canvas",
    "Measure": ".overlay",
    "Length": ".measuring .hint",
    "Mosaic": ".map-flat canvas",
}
"""What a part of the page shows when it is there, or when a button of it has been pressed."""
RANGES_ARE_READ = """(overlay => {
    const box = overlay.getBoundingClientRect();
    const place = { clientX: box.x + box.width / 2, clientY: box.y + box.height / 2 };
    overlay.dispatchEvent(new PointerEvent("pointermove", place));
    return document.querySelector(".measuring .readout").textContent.includes("±");
})(document.querySelector(".overlay"))"""
"""The pointer, over the middle of the picture to measure in, is told a range."""
CLOCK = """
for (const clock of [Date, performance]) {
    const now = clock.now.bind(clock);
    clock.now = () => clock.stopped ?? now();
}
globalThis.stopClock = () => {
    for (const clock of [Date, performance]) clock.stopped = clock.now();
};
"""
"""A clock of the page that ``stop_clock`` stops."""
PATIENCE_S = 60.0
"""A busy machine is no failure."""


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    if CHROMIUM is None:
        pytest.skip("Chromium is not installed (apt-get install chromium, or CHROMIUM=PATH)")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=CHROMIUM, args=list(SOFTWARE), timeout=2000 * PATIENCE_S
        )
        expect.set_options(timeout=1000 * PATIENCE_S)
        yield browser
        browser.close()


@pytest.fixture
def new_context(browser: Browser) -> Iterator[Callable[..., BrowserContext]]:
    """Makes contexts of a browser, by Playwright's options, in which pages do not scroll smoothly:
    what is clicked stands still. They are closed after the test.
    """
    made: list[BrowserContext] = []

    def make(width: int = 1200, height: int = 900, **options: Any) -> BrowserContext:
        context = browser.new_context(
            viewport={"width": width, "height": height}, reduced_motion="reduce", **options
        )
        context.set_default_timeout(1000 * PATIENCE_S)
        context.add_init_script(CLOCK)
        made.append(context)
        return context

    yield make
    for context in made:
        context.close()


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of three pairs, one of which failed, and one with markup as its name; to be read
    only.
    """
    folder = tmp_path_factory.mktemp("page")
    dive, out = write_dive(folder / "dive", 3), folder / "out"
    for side in "LR":
        (dive.root / side / "0002.png").rename(dive.root / side / f"{NASTY}.png")
    (dive.root / "L/0001.png").write_bytes(b"")
    run(
        dive.root / "L",
        dive.root / "R",
        dive.root / "cam.yaml",
        out,
        load_config(None, []),
        RunOptions(),
    )
    report(out)
    return out


@pytest.fixture
def opened(new_context: Callable[..., BrowserContext], out: Path) -> Iterator[Callable[..., Page]]:
    """Opens the page at a hash. Whatever it complains of, or asks a network for, fails the test."""
    context = new_context()
    complaints: list[str] = []

    def go(place: str, out: Path = out) -> Page:
        page = context.new_page()
        page.on(
            "console",
            lambda message: (
                complaints.append(message.text) if message.type in ("error", "warning") else None
            ),
        )
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on(
            "request",
            lambda request: complaints.append(request.url) if not _is_local(request.url) else None,
        )
        page.goto(f"{(out / 'index.html').as_uri()}#{place}")
        return page

    yield go
    assert not complaints


def until(page: Page, condition: str | Callable[[], bool]) -> None:
    """Wait for a condition, in the page's language or this one; the page's policy forbids
    Playwright's own way, which evaluates text inside the page.
    """
    end_s = time.monotonic() + PATIENCE_S
    while not (page.evaluate(condition) if isinstance(condition, str) else condition()):
        assert time.monotonic() < end_s, condition
        page.wait_for_timeout(30)


def box_of(shown: Locator) -> FloatRect:
    """Where something is in the window now, all of it in sight where that can be."""
    shown.scroll_into_view_if_needed()
    box = shown.bounding_box()
    assert box
    return box


def stop_clock(page: Page) -> None:
    """On the page no time goes by from here: a click, and two, are quick on a busy machine as
    well.
    """
    page.evaluate("stopClock()")


def _is_local(url: str) -> bool:
    return url.startswith(("file:", "data:", "blob:"))


def measuring(page: Page) -> Callable[[float, float], tuple[float, float]]:
    """Open the picture to measure in, and wait for its ranges. Returns ``window_place``."""
    page.get_by_role("button", name="Measure").click()
    until(page, "document.querySelector('.overlay')?.previousSibling.naturalWidth > 0")
    until(page, RANGES_ARE_READ)
    return partial(window_place, page)


def window_place(page: Page, x: float, y: float) -> tuple[float, float]:
    """Where a place of the picture to measure in, pixels of an image of 176x128, is in the
    window.
    """
    box = box_of(page.locator(".overlay"))
    return box["x"] + box["width"] * (x + 0.5) / 176, box["y"] + box["height"] * (y + 0.5) / 128


def stored(page: Page) -> list[dict[str, Any]]:
    """The measures that the browser keeps."""
    kept: list[dict[str, Any]] = json.loads(page.evaluate("Object.values(localStorage)[0] || '[]'"))
    return kept


@pytest.fixture(scope="module")
def mapped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with a map in tiles: flat, of one color, seen by four frames from above."""
    out = tmp_path_factory.mktemp("mapped") / "out"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("stereo_seecolor.report.mesh_levels.SIZES", MeshSizes(1000, 2000))
        mapped_run(out)
    return out


@pytest.fixture
def on_map(new_context: Callable[..., BrowserContext], mapped: Path) -> Iterator[Page]:
    page, complaints = new_context().new_page(), []
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on(
        "request",
        lambda request: complaints.append(request.url) if not _is_local(request.url) else None,
    )
    page.goto(f"{(mapped / 'index.html').as_uri()}#map")
    page.locator(".map-stage canvas").wait_for()
    yield page
    assert not complaints


def mapped_run(out: Path, frames: Sequence[SurveyFrame] | None = None, step_m: float = 0.3) -> None:
    write_run(out, frames or [flat_frame(i) for i in range(4)], PAIR)
    rows = [f"f{i},ok,0,,,{i},,\n" for i in range(4)]
    (out / "frames.csv").write_text(
        "name,status,kept,left,right,timestamp_s,error,warnings\n" + "".join(rows)
    )
    write_tum(out.with_name("track.tum"), track(4, step_m=step_m))
    fuse(out, out.with_name("track.tum"), RunConfig(mapping=CONFIG))
    report(out)


def middle_color(page: Page) -> np.ndarray:
    """The mean color of the middle of the map as it is drawn."""
    image = cv2.imdecode(
        np.frombuffer(page.locator(".map-stage").screenshot(), np.uint8), cv2.IMREAD_COLOR
    )
    height, width = image.shape[:2]
    return image[height * 2 // 5 : height * 3 // 5, width * 2 // 5 : width * 3 // 5].mean(
        axis=(0, 1)
    )


def until_drawn(page: Page) -> None:
    """Wait until the map has its color in the middle."""
    until(page, lambda: bool(abs(middle_color(page) - FLAT_BGR).max() < 12))


def map_in(context: BrowserContext, out: Path) -> Page:
    """The map of a run, in a new tab of a browser."""
    page = context.new_page()
    page.goto(f"{(out / 'index.html').as_uri()}#map")
    page.locator(".map-stage canvas").wait_for()
    return page
