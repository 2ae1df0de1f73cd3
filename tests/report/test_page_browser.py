"""The page in a real browser: opened from a file, nothing leaves it, and what is clicked
happens.
"""

import csv
import json
import os
import re
import shutil
import time
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from conftest import Dive, write_dive
from mapping_scene import CONFIG, PAIR, flat_frame, track, write_run
from plane_decoder import dive_of
from playwright.sync_api import (
    Browser,
    BrowserContext,
    FloatRect,
    Locator,
    Page,
    expect,
    sync_playwright,
)

from stereo_seecolor.color.white_point import white_errors, with_white
from stereo_seecolor.commands.fuse import fuse
from stereo_seecolor.commands.report import report
from stereo_seecolor.commands.run import run
from stereo_seecolor.config import RunConfig
from stereo_seecolor.config.file import load_config
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.extras.reef.measure import measure
from stereo_seecolor.extras.reef.metrics import metrics
from stereo_seecolor.files.srgb import decode_srgb
from stereo_seecolor.files.tum import write_tum
from stereo_seecolor.records import SurveyFrame, Water
from stereo_seecolor.report.map_mesh import RIM_SHADE, MeshSizes
from stereo_seecolor.report.templates import script

pytestmark = [pytest.mark.browser, pytest.mark.slow]

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


def test_the_overview_shows_its_pictures(opened: Callable[[str], Page]) -> None:
    page = opened("overview")
    assert (
        page.locator(".verdict .line")
        .inner_text()
        .endswith("Check this before you use the results:")
    )
    until(
        page,
        "[...document.querySelectorAll('.examples img')].every(image => image.naturalWidth > 0)",
    )
    assert page.locator("#frames").is_hidden()


def test_a_name_with_markup_is_text_everywhere(opened: Callable[[str], Page]) -> None:
    page = opened("overview")
    page.locator(".examples a", has_text=NASTY).first.click()
    expect(page.locator(".frame-name")).to_have_text(NASTY)
    until(page, "document.querySelector('.stage img').naturalWidth > 0")
    page.locator("a[data-tab=plots]").click()
    assert "fooled" not in page.title()


def test_the_slider_moves_by_key_and_by_mouse(opened: Callable[[str], Page]) -> None:
    page = opened("frames/0000")
    slider = page.locator(".stage .slider")
    slider.press("ArrowRight")
    assert slider.get_attribute("aria-valuenow") == "52"
    box = box_of(slider)
    page.mouse.click(box["x"] + box["width"] / 4, box["y"] + 20)
    until(
        page,
        "Math.abs(document.querySelector('.stage .slider').getAttribute('aria-valuenow') - 25) < 2",
    )


def test_the_strip_is_walked_by_keys_and_filtered(opened: Callable[[str], Page]) -> None:
    page = opened("frames/0000")
    page.locator(".strip").press("ArrowRight")
    expect(page.locator(".frame-name")).to_have_text("0001")
    assert page.locator(".stage .empty").inner_text() == "This frame has no image: Failed."
    page.locator(".toolbar select").first.select_option("failed")
    assert page.locator(".count").inner_text() == "1 of 3"
    assert page.locator(".strip-item").count() == 1


def test_the_range_under_the_pointer_is_the_one_measured(
    opened: Callable[[str], Page], out: Path
) -> None:
    from stereo_seecolor.run_folder.finished_run import open_run

    page = opened("frames/0000")
    page.get_by_role("button", name="Range").click()
    canvas = page.locator(".stage canvas")
    canvas.wait_for()
    box = box_of(canvas)
    width, height = open_run(out).geometry.image_size  # type: ignore[union-attr]
    page.mouse.move(
        box["x"] + box["width"] * (90.5 / width), box["y"] + box["height"] * (64.5 / height)
    )
    expected_m = open_run(out).frame("0000").measured_range_m()[64, 90]
    shown_m, std_mm = re.findall(r"[\d.]+", page.locator(".viewer > .readout").inner_text())[:2]
    # a range is rounded to a part of its standard error
    assert abs(float(shown_m) - expected_m) < 0.5e-3 * float(std_mm) + 0.5e-3


def test_a_white_within_its_error_is_chosen_by_sliders_and_saved_for_a_rerun(
    new_context: Callable[..., BrowserContext], make_dive: Callable[..., Dive], tmp_path: Path
) -> None:
    """What the page shows with it is what a run with the saved water makes."""
    dive, out = make_dive(2), tmp_path / "out"
    config = load_config(None, ["color.lock=survey"])
    run(dive.root / "L", dive.root / "R", dive.root / "cam.yaml", out, config)
    report(out)
    page = new_context().new_page()
    page.goto(f"{(out / 'index.html').as_uri()}#frames/0000")
    page.get_by_role("button", name="White point").click()
    until(page, "document.querySelector('.stage img').naturalWidth > 0")
    before = decode_srgb(screen(page, tmp_path))
    page.get_by_label("Red relative to green").fill("1")
    page.get_by_label("Blue relative to green").fill("-0.5")
    gains = np.median(decode_srgb(screen(page, tmp_path)) / np.maximum(before, 1e-6), axis=(0, 1))
    with page.expect_download() as saved:
        page.get_by_role("button", name="Save the water").click()
    saved.value.save_as(tmp_path / "water_white.json")
    page.locator(".stage img").click(position={"x": 5, "y": 5})
    assert "--white 0000:" in page.locator(".white .readout").inner_text()
    old, new = Water.load(out / "water.json"), Water.load(tmp_path / "water_white.json")
    red, blue = white_errors(old) * [1, -0.5]
    np.testing.assert_allclose(
        np.log(new.white / old.white), np.array([red, 0, blue]) - (red + blue) / 3, atol=1e-9
    )
    assert old.exposure and new.exposure == pytest.approx(
        with_white(old, new.white, np.zeros(3)).exposure
    )
    np.testing.assert_allclose(
        gains, old.white / new.white * new.exposure / old.exposure, rtol=0.03
    )
    run(
        dive.root / "L",
        dive.root / "R",
        dive.root / "cam.yaml",
        tmp_path / "again",
        config,
        RunOptions(water=tmp_path / "water_white.json"),
    )
    np.testing.assert_allclose(Water.load(tmp_path / "again/water.json").white, new.white)


def screen(page: Page, folder: Path) -> np.ndarray:
    """The middle of the picture as the screen shows it, RGB in [0, 1], in which nothing is clipped
    or nearly black.
    """
    page.locator(".stage img").screenshot(path=folder / "screen.png")
    shown = cv2.imread(str(folder / "screen.png"))[..., ::-1] / 255.0
    height, width = shown.shape[:2]
    return shown[height // 3 : -height // 3, width // 3 : -width // 3]


def measuring(page: Page) -> Callable[[float, float], tuple[float, float]]:
    """Open the picture to measure in, and wait for its ranges. Returns ``window_place``."""
    page.get_by_role("button", name="Measure").click()
    until(page, "document.querySelector('.overlay')?.previousSibling.naturalWidth > 0")
    until(page, RANGES_ARE_READ)
    return partial(window_place, page)


def clicked(page: Page, *places: tuple[float, float]) -> None:
    """Click places of the picture to measure in, pixels of an image of 176x128."""
    for x, y in places:
        page.mouse.click(*window_place(page, x, y))


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


def test_measures_in_the_browser_are_those_of_the_command_line(
    opened: Callable[[str], Page], out: Path, tmp_path: Path
) -> None:
    page = opened("frames/0000")
    measuring(page)
    clicked(page, (60, 40), (120, 50), (90, 70))
    page.get_by_role("button", name="Finish").click()
    page.get_by_role("button", name="Area", exact=True).click()
    clicked(page, (61, 79), (121, 82), (110, 111), (71, 105))
    page.locator(".overlay").press("Enter")
    page.get_by_role("button", name="Point", exact=True).click()
    clicked(page, (80, 30))
    expect(page.locator(".measures tbody tr")).to_have_count(3)
    with page.expect_download() as saved:
        page.get_by_role("button", name="Save as CSV").click()
    saved.value.save_as(tmp_path / "points.csv")
    for mine, theirs in zip(stored(page), measure(out, tmp_path / "points.csv"), strict=True):
        assert mine["value"] == pytest.approx(theirs.value, rel=3e-4)
        assert (mine["surface"] or 0) == pytest.approx(theirs.surface or 0, rel=3e-4)
        assert mine["std"] == pytest.approx(theirs.std, rel=0.03)


def test_a_double_click_ends_a_line_and_adds_no_point(opened: Callable[[str], Page]) -> None:
    page = opened("frames/0000")
    at = measuring(page)
    stop_clock(page)
    page.mouse.click(*at(60, 40))
    page.mouse.dblclick(*at(120, 50))
    expect(page.locator(".measures tbody tr")).to_have_count(1)
    (line,) = stored(page)
    np.testing.assert_allclose(line["places"], [(60, 40), (120, 50)], atol=0.3)
    page.get_by_role("button", name="Area", exact=True).click()
    page.mouse.click(*at(61, 79))
    page.mouse.click(*at(121, 82))
    page.mouse.dblclick(*at(110, 111))
    expect(page.locator(".measures tbody tr")).to_have_count(2)
    assert [len(each["places"]) for each in stored(page)] == [2, 3]
    assert page.evaluate("getSelection().toString()") == ""


def test_a_double_tap_ends_a_line_on_a_phone_and_nothing_is_wider_than_it(
    new_context: Callable[..., BrowserContext], out: Path
) -> None:
    page = new_context(390, 844, has_touch=True, is_mobile=True).new_page()
    page.goto(f"{(out / 'index.html').as_uri()}#frames/0000")
    at = measuring(page)
    stop_clock(page)
    page.touchscreen.tap(*at(60, 40))
    page.touchscreen.tap(*at(120, 50))
    page.touchscreen.tap(*at(120, 50))
    expect(page.locator(".measures tbody tr")).to_have_count(1)
    assert len(stored(page)[0]["places"]) == 2
    assert page.evaluate("document.documentElement.scrollWidth") <= 390


def test_the_picture_is_zoomed_and_moved_while_it_is_measured_in(
    opened: Callable[[str], Page],
) -> None:
    page = opened("frames/0000")
    at = measuring(page)
    width = page.locator(".overlay").bounding_box()["width"]  # type: ignore[index]
    spot = at(60, 40)
    page.mouse.move(*spot)
    page.mouse.wheel(0, -600)
    until(page, f"document.querySelector('.overlay').getBoundingClientRect().width > {2 * width}")
    # stays under the pointer, to a whole pixel times the zoom
    np.testing.assert_allclose(at(60, 40), spot, atol=2)
    spot = at(60, 40)
    page.mouse.click(*spot)
    page.mouse.move(spot[0] + 80, spot[1] + 60)
    page.mouse.down()
    page.mouse.move(spot[0] + 40, spot[1] + 20, steps=4)
    page.mouse.up()
    # dragging moves it, and sets no point
    np.testing.assert_allclose(at(60, 40), (spot[0] - 40, spot[1] - 40), atol=1)
    page.mouse.click(*at(75, 50))
    page.get_by_role("button", name="Finish").click()
    np.testing.assert_allclose(stored(page)[0]["places"], [(60, 40), (75, 50)], atol=0.2)


def test_the_tools_for_measuring_stand_above_the_fold(
    new_context: Callable[..., BrowserContext], out: Path
) -> None:
    page = new_context(1400, 900).new_page()
    page.goto(f"{(out / 'index.html').as_uri()}#frames/0000")
    measuring(page)
    for name in ("Finish", "Undo"):
        box = page.get_by_role("button", name=name).bounding_box()
        assert box and box["y"] + box["height"] < 900
    box = page.locator(".overlay").bounding_box()
    assert box and box["y"] + box["height"] <= 900


def test_a_point_that_is_dragged_is_measured_anew(
    opened: Callable[[str], Page], out: Path, tmp_path: Path
) -> None:
    page = opened("frames/0000")
    measuring(page)
    clicked(page, (60, 40), (120, 50))
    page.get_by_role("button", name="Finish").click()
    before_m = stored(page)[0]["value"]
    place, other = window_place(page, 120, 50), window_place(page, 90, 70)
    page.mouse.move(*place)
    page.mouse.down()
    page.mouse.move(*other, steps=5)
    page.mouse.up()
    with page.expect_download() as saved:
        page.get_by_role("button", name="Save as CSV").click()
    saved.value.save_as(tmp_path / "points.csv")
    (dragged,), (theirs,) = stored(page), measure(out, tmp_path / "points.csv")
    assert dragged["places"] == [pytest.approx([60, 40], abs=0.6), pytest.approx([90, 70], abs=0.6)]
    # the page holds each range to a sixth of its standard error
    assert dragged["value"] == pytest.approx(theirs.value, abs=theirs.std / 6)
    assert abs(dragged["value"] - before_m) > 0.01


def test_measures_are_undone_labelled_kept_and_exported(
    opened: Callable[[str], Page], tmp_path: Path
) -> None:
    page = opened("frames/0000")
    measuring(page)
    overlay = page.locator(".overlay")
    overlay.focus()
    overlay.press(" ")
    for _ in range(3):
        overlay.press("Shift+ArrowRight")
    overlay.press(" ")
    overlay.press("Enter")
    page.locator(".measures input.label").fill('=HYPERLINK("x"), massive')
    page.locator(".measures input.label").press("Tab")
    page.locator(".measures input.note").fill("bleached")
    page.locator(".measures input.note").press("Tab")
    with page.expect_download() as saved:
        page.get_by_role("button", name="Save for VIAME").click()
    saved.value.save_as(tmp_path / "viame.csv")
    row = next(csv.reader(tmp_path.joinpath("viame.csv").read_text().splitlines()[1:]))
    assert row[:3] == ["1", "0000.png", "0"]
    assert float(row[8]) == pytest.approx(1000 * stored(page)[0]["value"], abs=0.01)
    assert row[9] == '\'=HYPERLINK("x"), massive'  # no formula for a spreadsheet
    page.reload()
    assert (stored(page)[0]["label"], stored(page)[0]["note"]) == (
        '=HYPERLINK("x"), massive',
        "bleached",
    )
    page.get_by_role("button", name="Measure").click()
    page.get_by_role("button", name="Delete measurement 1").click()
    expect(page.locator(".measures tbody tr")).to_have_count(0)
    page.get_by_role("button", name="Undo").click()
    expect(page.locator(".measures tbody tr")).to_have_count(1)


def test_plots_are_drawn_and_lead_to_their_frames(opened: Callable[[str], Page], out: Path) -> None:
    page = opened("plots")
    curves = dive_of(out)["plots"]["seconds"]
    expect(page.locator(".plot").last.locator(".u-legend .u-label").last).to_be_visible()
    labels = [
        each
        for each in page.locator(".plot").last.locator(".u-legend .u-label").all()
        if each.is_visible()
    ]
    assert [each.inner_text() for each in labels] == list(curves)
    plot = page.locator(".plot .u-over").first
    box = box_of(plot)
    plot.click(position={"x": box["width"] - 4, "y": 40})
    until(page, "location.hash.startsWith('#frames/')")
    expect(page.locator(".frame-name")).to_have_text(NASTY)


@pytest.mark.slow
def test_of_thousands_of_frames_only_those_in_sight_are_in_the_page(
    opened: Callable[..., Page], out: Path, tmp_path: Path
) -> None:
    out = shutil.copytree(out, tmp_path / "out")
    dive, count = dive_of(out), 5000
    dive |= {"plots": {}, "blocks": []}
    frames = {key: dive.pop(key) for key in ("errors", "problems", "products")}
    frames |= {
        "names": [f"n{i}" for i in range(count)],
        "status": ["failed"] * count,
        "problems_of": {},
        "shown": [-1] * count,
        "shelves": [],
    }
    dive["frames"] = zlib.compress(json.dumps(frames).encode())
    (out / "page/dive.js").write_bytes(script("dive", dive))
    page = opened("frames/n2500", out)
    expect(page.locator(".frame-name")).to_have_text("n2500")
    assert page.locator(".strip-item").count() < 60
    expect(page.locator("#strip-2500")).to_be_visible()
    page.locator(".strip").press("End")
    expect(page.locator("#strip-4999")).to_be_visible()


def test_nothing_is_wider_than_a_phone(
    new_context: Callable[..., BrowserContext], out: Path
) -> None:
    page = new_context(360, 740).new_page()
    for place in ("overview", "frames", "plots"):
        page.goto(f"{(out / 'index.html').as_uri()}#{place}")
        page.locator(SHOWN[place]).first.wait_for()
        assert page.evaluate("document.documentElement.scrollWidth") <= 360
        assert page.evaluate(
            "(tabs => tabs.scrollWidth <= tabs.clientWidth)(document.querySelector('.tabs'))"
        )


# The map


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


def at_rest(page: Page) -> bytes:
    """The map as it is drawn once nothing of it moves or is loaded any more."""
    drawn: list[bytes] = []

    def rests() -> bool:
        page.wait_for_timeout(100)
        drawn.append(page.locator(".map-stage").screenshot())
        is_busy = page.locator(".map-stage [aria-busy=true]").count()
        return not is_busy and drawn[-2:-1] == drawn[-1:]

    until(page, rests)
    return drawn[-1]


@pytest.mark.slow
def test_the_map_is_drawn_in_its_colors_and_a_click_finds_the_frames(on_map: Page) -> None:
    until_drawn(on_map)
    box = box_of(on_map.locator(".map-stage canvas"))
    on_map.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    found = on_map.locator(".found .card")
    found.first.wait_for()
    assert 1 <= found.count() <= 4
    found.first.click()
    expect(on_map.locator("#frames .frame-name")).to_be_visible()


def blank_frame(i: int) -> SurveyFrame:
    """Without ranges in the middle: 19 x 22 cm of the ground."""
    frame = flat_frame(i)
    frame.range_m[50:75, 65:95] = np.nan
    return frame


@pytest.mark.slow
def test_a_gap_is_hatched_with_a_dark_edge_and_a_click_on_it_says_why(
    new_context: Callable[..., BrowserContext], tmp_path: Path
) -> None:
    out = tmp_path / "out"
    mapped_run(out, [blank_frame(i) for i in range(4)], step_m=0.0)
    page = new_context().new_page()
    page.goto(f"{(out / 'index.html').as_uri()}#map")
    page.locator(".map-stage canvas").wait_for()
    solid = at_rest(page)
    for view, middle in (("In three dimensions", (0.48, 0.33)), ("Mosaic", (0.5, 0.5))):
        page.get_by_role("button", name=view).click()
        at_rest(page)
        box = box_of(page.locator(".map-stage"))
        x, y = middle
        page.mouse.click(box["x"] + x * box["width"], box["y"] + y * box["height"])
        expect(page.locator(".found")).to_contain_text("No range: images show this spot")
        expect(page.locator(".found .card").first).to_be_visible()
        page.mouse.click(box["x"] + box["width"] / 2, box["y"] + 0.7 * box["height"])
        expect(page.locator(".found")).to_contain_text("frames saw this spot")
    assert contrast(page.locator(".map-stage").screenshot()) > 30  # light and dark stripes
    image = cv2.imdecode(np.frombuffer(solid, np.uint8), cv2.IMREAD_COLOR).astype(int)
    assert (abs(image - (FLAT_BGR - RIM_SHADE).clip(0)).max(axis=2) < 25).sum() > 100


STRIPES_M, STRIPES_LEVELS = 0.02, 40
"""Period and amplitude of stripes that the images resolve (2.7 pixels), and voxels of 2 cm do
not.
"""


def striped_frame(i: int) -> SurveyFrame:
    x_m = track(4).T_world_camera[i, 0, 3] + (np.arange(160) - 80) / 200 * 1.5
    stripes = STRIPES_LEVELS * np.sin(2 * np.pi * x_m / STRIPES_M)
    rgb = np.clip(np.rint(128 + stripes), 0, 255).astype(np.uint8)
    return replace(flat_frame(i), color=np.tile(rgb[None, :, None], (128, 1, 3)))


@pytest.mark.slow
def test_a_zoom_by_wheel_shows_what_the_images_resolve_and_the_relief_stays_gray(
    new_context: Callable[..., BrowserContext], tmp_path: Path
) -> None:
    """The colors of voxels make fewer and wider stripes of them."""
    out = tmp_path / "out"
    mapped_run(out, [striped_frame(i) for i in range(4)])
    page = new_context().new_page()

    def seen() -> bytes:
        page.goto("about:blank")
        page.goto(f"{(out / 'index.html').as_uri()}#map")
        page.locator(".map-stage canvas").wait_for()
        at_rest(page)
        box = box_of(page.locator(".map-stage canvas"))
        page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        for _ in range(8):
            page.mouse.wheel(0, -240)
        return at_rest(page)

    sharp = seen()
    assert contrast(sharp) > 0.5 * STRIPES_LEVELS
    page.get_by_role("button", name="Relief").click()
    until(page, lambda: contrast(at_rest(page)) < 0.1 * STRIPES_LEVELS)
    page.locator(".map-stage canvas").click()
    page.locator(".found .card").first.wait_for()
    listed = out / "page" / "map" / "map.js"
    listed.write_text(listed.read_text("utf-8").replace('"textured":', '"unused":'), "utf-8")
    assert stripes(sharp) > 2 * stripes(seen())


def middle(screenshot: bytes) -> np.ndarray:
    """The middle of the map, in gray."""
    image = cv2.imdecode(np.frombuffer(screenshot, np.uint8), cv2.IMREAD_GRAYSCALE)
    height, width = image.shape
    return image[height * 2 // 5 : height * 3 // 5, width * 2 // 5 : width * 3 // 5].astype(float)


def contrast(screenshot: bytes) -> float:
    """The amplitude of stripes in the middle of the map."""
    return float(np.sqrt(2) * middle(screenshot).std())


def stripes(screenshot: bytes) -> int:
    """How often it is light in the middle row of the map, beside dark."""
    row = middle(screenshot)
    is_light = row[len(row) // 2] > row.mean()
    return int((is_light[1:] & ~is_light[:-1]).sum())


@pytest.mark.slow
def test_the_whole_map_is_seen_in_a_window_that_changes_its_shape(on_map: Page) -> None:
    until_drawn(on_map)
    on_map.set_viewport_size({"width": 390, "height": 1000})
    until(on_map, "document.querySelector('.map-stage canvas').clientWidth < 390")
    turned = map_box(at_rest(on_map))
    assert turned["right"] - turned["left"] > 0.9
    on_map.get_by_role("button", name="Whole map").click()
    assert map_box(at_rest(on_map)) == pytest.approx(turned, abs=0.01)


def map_box(screenshot: bytes) -> dict[str, float]:
    """Where the map is on its stage, from 0 to 1 of the width and the height."""
    image = cv2.imdecode(np.frombuffer(screenshot, np.uint8), cv2.IMREAD_COLOR)
    blue, _, red = np.moveaxis(image.astype(int), 2, 0)
    is_map = red > blue + 10  # its shaded edge, too; the ground and the track are blue
    assert not np.concatenate([is_map[[0, -1]].ravel(), is_map[:, [0, -1]].ravel()]).any()
    rows, columns = np.nonzero(is_map)
    height, width = is_map.shape
    return {
        "left": columns.min() / width,
        "right": columns.max() / width,
        "top": rows.min() / height,
        "bottom": rows.max() / height,
    }


@pytest.mark.slow
def test_the_mosaic_is_zoomed_into_and_a_click_finds_the_frames(on_map: Page) -> None:
    on_map.get_by_role("button", name="Mosaic").click()
    until_drawn(on_map)
    on_map.get_by_role("button", name="Closer").click()
    on_map.get_by_role("button", name="Terrain").click()
    stop_clock(on_map)
    box = box_of(on_map.locator(".map-flat"))
    on_map.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    on_map.locator(".found .card").first.wait_for()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_no_fault(
    new_context: Callable[..., BrowserContext], mapped: Path, scheme: Literal["light", "dark"]
) -> None:
    page = new_context(color_scheme=scheme).new_page()
    for place, pressed in (
        ("overview", ""),
        ("frames", ""),
        ("frames", "Measure"),
        ("map", "Length"),
        ("map", "Mosaic"),
    ):
        page.goto(f"{(mapped / 'index.html').as_uri()}#{place}")
        page.locator(SHOWN[place]).first.wait_for()
        if pressed:
            page.locator(f"#{place}").get_by_role("button", name=pressed, exact=True).click()
            page.locator(f"#{place} {SHOWN[pressed]}").first.wait_for()
        found = Axe().run(page)
        assert found.response["passes"]
        assert not found.response["violations"], (place, pressed, found.generate_report())


@pytest.mark.slow
def test_hillshade_is_offered_where_it_changes_what_is_shown(on_map: Page) -> None:
    shade = on_map.get_by_role("button", name="Hillshade")
    for view, there in (
        ("Mosaic", True),
        ("Terrain", False),
        ("In three dimensions", False),
        ("Relief", False),
    ):
        on_map.get_by_role("button", name=view, exact=True).click()
        expect(shade).to_be_visible(visible=there)


def test_a_piece_without_its_file_is_shown_coarsely_and_the_map_rests(
    mapped: Path, new_context: Callable[..., BrowserContext], tmp_path: Path
) -> None:
    copy = shutil.copytree(mapped, tmp_path / "out")
    for file in (copy / "page/map").glob("textured_*.js"):
        file.unlink()
    page = new_context().new_page()
    page.goto(f"{(copy / 'index.html').as_uri()}#map")
    page.locator(".map-stage canvas").wait_for()
    at_rest(page)
    assert int(page.locator(".map-stage canvas").get_attribute("data-triangles") or 0) > 0


@pytest.mark.slow
def test_frames_are_looked_for_at_the_height_of_the_terrain(
    mapped: Path, new_context: Callable[..., BrowserContext], tmp_path: Path
) -> None:
    """And not at the middle height of a piece, which is made wrong here."""
    copy = shutil.copytree(mapped, tmp_path / "out")
    file = copy / "page/map/map.js"
    head, about = file.read_text("ascii").split("(", 1)
    about = json.loads(about.removesuffix(");\n"))
    for each in about["pieces"].values():
        each["high_m"][2] += 1
    file.write_text(f"{head}({json.dumps(about)});\n", "ascii")
    page = new_context().new_page()
    page.goto(f"{(copy / 'index.html').as_uri()}#map")
    page.get_by_role("button", name="Terrain").click()
    page.locator(".map-bar").wait_for()
    stop_clock(page)
    box = box_of(page.locator(".map-flat"))
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    found = page.locator(".found h2")
    found.wait_for()
    height_m = float(re.findall(r"-?[0-9.]+(?= m\))", found.inner_text())[0])
    assert about["terrain"]["low_m"] - 0.01 < height_m < about["terrain"]["high_m"] + 0.01


@pytest.mark.parametrize("view", ["In three dimensions", "Mosaic"])
def test_a_double_click_ends_a_line_on_the_map(on_map: Page, view: str) -> None:
    on_map.get_by_role("button", name=view).click()
    until_drawn(on_map)
    on_map.get_by_role("button", name="Length", exact=True).click()
    box = box_of(on_map.locator(".map-stage"))
    places = [(box["x"] + box["width"] * x, box["y"] + 0.45 * box["height"]) for x in (0.46, 0.54)]
    stop_clock(on_map)
    on_map.mouse.click(*places[0])
    expect(on_map.locator(".map-overlay .dot:not([data-id])")).to_have_count(1)
    on_map.mouse.dblclick(*places[1])
    expect(on_map.locator("#map .measures tbody tr")).to_have_count(1)
    (line,) = stored(on_map)
    assert len(line["points"]) == 2


@pytest.mark.slow
@pytest.mark.parametrize("view", ["In three dimensions", "Mosaic"])
def test_measures_on_the_map_are_those_of_the_command_line(
    on_map: Page, mapped: Path, tmp_path: Path, view: str
) -> None:
    on_map.get_by_role("button", name=view).click()
    until_drawn(on_map)
    stop_clock(on_map)
    for number, kind in enumerate(("Length", "Area", "Point"), start=1):
        # beside earlier ones
        corners = (
            (0.46, 0.4 + 0.05 * number),
            (0.54, 0.4 + 0.05 * number),
            (0.5, 0.46 + 0.05 * number),
        )
        on_map.get_by_role("button", name=kind, exact=True).click()
        box = box_of(on_map.locator(".map-stage"))
        places = [(box["x"] + box["width"] * x, box["y"] + box["height"] * y) for x, y in corners]
        count = {"Length": 2, "Area": 3, "Point": 1}[kind]
        for dots, place in enumerate(places[:count], start=1):
            on_map.mouse.click(*place)
            if kind != "Point":
                expect(on_map.locator(".map-overlay .dot:not([data-id])")).to_have_count(dots)
        if kind != "Point":
            on_map.locator("#map").get_by_role("button", name="Finish").click()
        expect(on_map.locator("#map .measures tbody tr")).to_have_count(number)
    with on_map.expect_download() as saved:
        on_map.get_by_role("button", name="Save as CSV").click()
    saved.value.save_as(tmp_path / "points.csv")
    with on_map.expect_download() as saved:
        on_map.get_by_role("button", name="Save measurements (JSON)").click()
    saved.value.save_as(tmp_path / "measures.json")
    for name in ("points.csv", "measures.json"):
        for mine, theirs in zip(stored(on_map), measure(mapped, tmp_path / name), strict=True):
            assert mine["value"] == pytest.approx(theirs.value, rel=1e-3, abs=1e-5)
            assert mine["std"] == pytest.approx(theirs.std, rel=1e-3)
            assert (mine["surface"] or 0) == pytest.approx(theirs.surface or 0, rel=2e-3)
            assert (mine.get("volume_l") or 0) == pytest.approx(theirs.volume_l or 0, abs=0.01)
            std_l = theirs.volume_std_l or 0
            assert (mine.get("volume_std_l") or 0) == pytest.approx(std_l, rel=0.01)


def map_in(context: BrowserContext, out: Path) -> Page:
    """The map of a run, in a new tab of a browser."""
    page = context.new_page()
    page.goto(f"{(out / 'index.html').as_uri()}#map")
    page.locator(".map-stage canvas").wait_for()
    return page


@pytest.mark.slow
def test_measures_beside_the_page_are_found_in_another_browser_and_tabs_share_them(
    new_context: Callable[..., BrowserContext], mapped: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    shutil.copytree(mapped, out)

    def opened(context: BrowserContext) -> Page:
        page = map_in(context, out)
        page.get_by_role("button", name="Point", exact=True).click()
        return page

    def labels(page: Page) -> Locator:
        return page.locator("#map .measures input.label")

    mine = new_context()
    tabs = [opened(mine), opened(mine)]
    for number, tab in enumerate(tabs, 1):  # each measures, and labels what the other measured
        until_drawn(tab)
        box = box_of(tab.locator(".map-stage"))
        tab.mouse.click(box["x"] + (0.4 + 0.05 * number) * box["width"], box["y"] + 300)
        expect(labels(tab)).to_have_count(number)
    expect(labels(tabs[0])).to_have_count(2)
    labels(tabs[0]).nth(1).fill("Porites")
    labels(tabs[1]).nth(0).fill("Acropora")
    for tab in tabs:
        expect(labels(tab).nth(0)).to_have_value("Acropora")
        expect(labels(tab).nth(1)).to_have_value("Porites")
    with tabs[0].expect_download() as saved:
        tabs[0].get_by_role("button", name="Save measurements (JSON)").click()
    theirs = opened(new_context())
    expect(labels(theirs)).to_have_count(0)
    saved.value.save_as(out / "measures.json")
    report(out)
    theirs = opened(new_context())
    expect(labels(theirs).nth(1)).to_have_value("Porites")
    theirs.get_by_role("button", name="Delete measurement 1").click()
    theirs.reload()
    theirs.get_by_role("button", name="Point", exact=True).click()
    expect(labels(theirs)).to_have_count(1)
    theirs.get_by_label("Load measurements (JSON)").set_input_files(out / "measures.json")
    expect(labels(theirs)).to_have_count(2)


def test_random_points_are_labelled_counted_and_saved(on_map: Page, tmp_path: Path) -> None:
    """The interval of 4 of 5 is Wilson's, from his paper's formula worked by hand."""
    on_map.get_by_label("How many points").fill("12")
    on_map.get_by_role("button", name="Random points").click()
    expect(on_map.locator(".cover output").first).to_have_text("0 of 12 labeled")
    expect(on_map.locator(".map-marks .point")).to_have_count(1)
    label = on_map.get_by_label("Label of this point")
    for name in ("Sand", "Sand", "Rock", "Sand", "Sponge"):
        label.fill(name)
        label.press("Enter")
    on_map.get_by_role("button", name="Remove the last label").click()
    on_map.get_by_role("button", name="This point is Sand").click()
    expect(on_map.locator(".cover output").first).to_have_text("5 of 12 labeled")
    first = on_map.locator(".cover tbody tr").first.locator("td")
    assert first.all_inner_texts() == ["Sand", "4", "80 %", "37.6 to 96.4 %"]
    with on_map.expect_download() as saved:
        on_map.get_by_role("button", name="Save points as CSV").click()
    saved.value.save_as(tmp_path / "points.csv")
    rows = (tmp_path / "points.csv").read_text().splitlines()
    assert rows[0] == "point,x_m,y_m,label" and len(rows) == 13
    assert sum(row.endswith(",Sand") for row in rows) == 4


def test_random_points_beside_the_page_are_found_in_another_browser(
    new_context: Callable[..., BrowserContext], mapped: Path, tmp_path: Path
) -> None:
    """By mouse; points that the file replaces come back by Undo."""
    out = tmp_path / "out"
    shutil.copytree(mapped, out)

    def placed(page: Page, count: int, *labels: str) -> None:
        page.get_by_label("How many points").fill(str(count))
        page.get_by_role("button", name="Random points").click()
        expect(done(page)).to_have_text(f"0 of {count} labeled")
        for label in labels:
            page.get_by_label("Label of this point").click()
            page.keyboard.type(label)
            page.keyboard.press("Enter")

    def done(page: Page) -> Locator:
        return page.locator(".cover-bar output")

    mine, theirs = map_in(new_context(), out), map_in(new_context(), out)
    placed(theirs, 10)
    placed(mine, 12, "Sand", "Rock", "Sand")
    other_tab = mine.context.new_page()
    other_tab.goto(mine.url)
    expect(done(other_tab)).to_have_text("3 of 12 labeled")
    with mine.expect_download() as saved:
        mine.get_by_role("button", name="Save points and measurements (JSON)").click()
    saved.value.save_as(out / "measures.json")
    report(out)
    new = map_in(new_context(), out)
    expect(done(new)).to_have_text("3 of 12 labeled")
    first = new.locator(".cover tbody tr").first.locator("td")
    assert first.all_inner_texts()[:2] == ["Sand", "2"]
    theirs.reload()
    expect(done(theirs)).to_have_text("3 of 12 labeled")
    for _ in range(4):
        theirs.get_by_role("button", name="Remove the last label").click()
    expect(done(theirs)).to_have_text("0 of 10 labeled")
    assert measure(out, out / "measures.json") == []


@pytest.mark.parametrize(("width", "height"), [(1400, 900), (390, 844)])
def test_labels_that_are_typed_one_after_the_other_all_stay(
    new_context: Callable[..., BrowserContext], mapped: Path, width: int, height: int
) -> None:
    """By mouse from field to field, by Tab, and without leaving the last field."""
    page = new_context(width, height).new_page()
    page.goto(f"{(mapped / 'index.html').as_uri()}#map")
    page.get_by_role("button", name="Mosaic", exact=True).click()
    until_drawn(page)
    stop_clock(page)
    page.get_by_role("button", name="Point", exact=True).click()
    for number, x in enumerate((0.4, 0.5, 0.6), start=1):
        box = box_of(page.locator(".map-stage"))
        page.mouse.click(box["x"] + box["width"] * x, box["y"] + 0.5 * box["height"])
        expect(page.locator("#map .measures tbody tr")).to_have_count(number)
    for number in (1, 2, 3):
        box = box_of(page.get_by_label(f"Label of measurement {number}", exact=True))
        page.mouse.click(box["x"] + 10, box["y"] + box["height"] / 2)
        page.keyboard.type(f"Sand {number}")
    assert [each["label"] for each in stored(page)] == ["Sand 1", "Sand 2", "Sand 3"]
    box = box_of(page.locator("#map .measures input.note").first)
    page.mouse.click(box["x"] + 10, box["y"] + box["height"] / 2)
    for name in ("first", "second", "third"):
        page.keyboard.type(name)
        for _ in range(4):  # the button that deletes, the next label, its frame, its note
            page.keyboard.press("Tab")
    assert [each.get("note") for each in stored(page)] == ["first", "second", "third"]
    page.reload()
    assert [each["label"] for each in stored(page)] == ["Sand 1", "Sand 2", "Sand 3"]
    assert page.evaluate("document.documentElement.scrollWidth") <= width


def test_a_button_beside_a_field_is_pressed_by_the_click_that_leaves_the_field(
    on_map: Page,
) -> None:
    on_map.get_by_role("button", name="Mosaic", exact=True).click()
    until_drawn(on_map)
    stop_clock(on_map)
    on_map.get_by_role("button", name="Point", exact=True).click()
    for number, x in enumerate((0.4, 0.6), start=1):
        box = box_of(on_map.locator(".map-stage"))
        on_map.mouse.click(box["x"] + box["width"] * x, box["y"] + 0.5 * box["height"])
        expect(on_map.locator("#map .measures tbody tr")).to_have_count(number)
    on_map.get_by_label("Label of measurement 1", exact=True).click()
    on_map.keyboard.type("Rock")
    on_map.get_by_role("button", name="Delete measurement 2").click()
    expect(on_map.locator("#map .measures tbody tr")).to_have_count(1)
    on_map.get_by_label("Label of measurement 1", exact=True).click()
    on_map.keyboard.type("s")
    on_map.get_by_role("button", name="Remove the last measurement labeled Rocks").click()
    expect(on_map.locator("#map .measures tbody tr")).to_have_count(0)


@pytest.mark.parametrize(("width", "height"), [(1400, 900), (390, 844)])
def test_the_map_is_in_sight_while_its_points_are_labelled(
    new_context: Callable[..., BrowserContext], mapped: Path, width: int, height: int
) -> None:
    page = new_context(width, height).new_page()
    page.goto(f"{(mapped / 'index.html').as_uri()}#map")
    page.locator(".map-stage canvas").wait_for()
    page.get_by_label("How many points").fill("5")
    page.get_by_role("button", name="Random points").click()
    for done, by_mouse in enumerate((False, False, True, False)):
        expect(page.locator(".cover output").first).to_have_text(f"{done} of 5 labeled")
        everything_in_sight(page, height)
        if by_mouse:
            page.get_by_role("button", name="This point is Sand").click()
        else:
            page.keyboard.type("Sand")
            page.keyboard.press("Enter")
        if by_mouse:
            page.get_by_label("Label of this point").click()
    assert page.evaluate("document.documentElement.scrollWidth") <= width


def everything_in_sight(page: Page, height: int) -> None:
    """The whole map, its marked point and the field for its label are between the header and the
    lower edge, and the point is on the map.
    """
    header = page.locator(".top").bounding_box()
    assert header
    mark = page.locator(".map-marks .point")

    def settled() -> bool:
        boxes = [
            page.locator(each).bounding_box()
            for each in (".map-stage", ".map-marks .point", ".cover-bar input")
        ]
        if not all(boxes):
            return False
        stage, point, _ = boxes
        assert stage and point
        return stage["y"] < point["y"] < stage["y"] + stage["height"] and all(
            header["y"] + header["height"] <= each["y"] <= height - each["height"]
            for each in boxes
            if each
        )

    expect(mark).to_have_count(1)
    until(page, settled)


def test_points_that_others_replace_come_back(on_map: Page) -> None:
    on_map.get_by_label("How many points").fill("10")
    on_map.get_by_role("button", name="Random points").click()
    expect(on_map.locator(".cover output").first).to_have_text("0 of 10 labeled")
    on_map.keyboard.type("Sand")
    on_map.keyboard.press("Enter")
    on_map.get_by_label("How many points").fill("12")
    on_map.get_by_role("button", name="Random points").click()
    expect(on_map.locator(".cover output").first).to_have_text("0 of 12 labeled")
    on_map.get_by_role("button", name="Remove the last label").click()
    expect(on_map.locator(".cover output").first).to_have_text("1 of 10 labeled")


@pytest.mark.parametrize("view", ["In three dimensions", "Mosaic", "Terrain"])
def test_the_page_stands_still_when_the_map_is_tapped(
    new_context: Callable[..., BrowserContext], mapped: Path, view: str
) -> None:
    page = new_context(390, 844, has_touch=True, is_mobile=True).new_page()
    page.goto(f"{(mapped / 'index.html').as_uri()}#map")
    page.get_by_role("button", name=view, exact=True).click()
    page.locator(".map-stage canvas").first.wait_for()
    at_rest(page)
    page.evaluate("scrollTo(0, 0)")
    box = page.locator(".map-stage").bounding_box()
    assert box
    page.touchscreen.tap(195, box["y"] + box["height"] / 2)
    page.locator(".found h2").wait_for()
    assert page.locator(".map-stage").bounding_box() == box


def test_the_frame_stands_still_when_it_is_tapped(
    new_context: Callable[..., BrowserContext], out: Path
) -> None:
    page = new_context(390, 640, has_touch=True, is_mobile=True).new_page()
    page.goto(f"{(out / 'index.html').as_uri()}#frames/0000")
    measuring(page)
    page.evaluate("scrollTo(0, 0)")
    box = page.locator(".overlay").bounding_box()
    assert box and box["y"] + 20 < 640 < box["y"] + box["height"]
    page.touchscreen.tap(195, box["y"] + 10)
    expect(page.locator(".overlay .dot")).to_have_count(1)
    assert page.locator(".overlay").bounding_box() == box


@pytest.mark.parametrize(("width", "height"), [(1400, 900), (390, 844)])
def test_the_map_is_turned_where_it_is_after_a_zoom(
    new_context: Callable[..., BrowserContext], mapped: Path, width: int, height: int
) -> None:
    """The reef in the middle of the view stays there."""
    page = new_context(width, height).new_page()
    page.goto(f"{(mapped / 'index.html').as_uri()}#map")
    page.locator(".map-stage canvas").wait_for()
    at_rest(page)
    box = box_of(page.locator(".map-stage"))
    middle = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(middle[0] + 20, middle[1] + 30)
    for _ in range(10):
        page.mouse.wheel(0, -300)
        page.wait_for_timeout(50)
    at_rest(page)
    before = spot_at(page, middle)
    page.mouse.move(*middle)
    page.mouse.down(button="right")
    page.mouse.move(middle[0] + 90, middle[1] - 40, steps=5)
    page.mouse.up(button="right")
    at_rest(page)
    assert np.linalg.norm(spot_at(page, middle) - before) < 0.03


def spot_at(page: Page, place: tuple[float, float]) -> np.ndarray:
    """The spot of the map that is found by a click at a place of the window, meters."""
    page.evaluate("document.querySelector('.found').replaceChildren()")
    page.mouse.click(*place)
    text = page.locator(".found h2").inner_text()
    return np.array(re.findall(r"-?[0-9.]+", text)[-3:], float)


def test_points_go_to_coralnet_and_come_back_with_labels(
    on_map: Page, mapped: Path, tmp_path: Path
) -> None:
    """The table has the form that CoralNet exports; ``metrics`` counts the same labels."""
    on_map.get_by_label("How many points").fill("12")
    on_map.get_by_role("button", name="Random points").click()
    expect(on_map.locator(".cover output").first).to_have_text("0 of 12 labeled")
    with on_map.expect_download() as saved:
        on_map.get_by_role("button", name="Save points for CoralNet").click()
    saved.value.save_as(tmp_path / "points.csv")
    with (tmp_path / "points.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [*rows[0]] == ["Name", "Row", "Column", "Label"] and len(rows) == 12
    assert {row["Name"] for row in rows} == {"0_0.png"}
    for number, row in enumerate(rows):
        row["Label"] = "Porites, massive" if number < 9 else "CCA"
    rows.append({"Name": "f1.png", "Row": "20", "Column": "30", "Label": "CCA"})
    with (tmp_path / "annotations.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, [*rows[0]])
        writer.writeheader()
        writer.writerows(rows)
    on_map.get_by_label("Load CoralNet's annotations").set_input_files(tmp_path / "annotations.csv")
    expect(on_map.locator(".cover output").first).to_have_text("13 of 13 labeled")
    first = on_map.locator(".cover tbody tr").first.locator("td")
    found = metrics(mapped, points=tmp_path / "annotations.csv").point_cover
    assert [(each.label, each.points) for each in found] == [("Porites, massive", 9), ("CCA", 4)]
    low, high = (100 * value for value in (found[0].low, found[0].high))
    assert first.all_inner_texts() == [
        "Porites, massive",
        "9",
        f"{100 * 9 / 13:.3g} %",
        f"{low:.3g} to {high:.3g} %",
    ]
    on_map.get_by_role("button", name="Remove the last label").click()
    expect(on_map.locator(".cover output").first).to_have_text("12 of 13 labeled")
    rows[3]["Name"] = "other.png"
    with (tmp_path / "wrong.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, [*rows[0]])
        writer.writeheader()
        writer.writerows(rows)
    on_map.get_by_label("Load CoralNet's annotations").set_input_files(tmp_path / "wrong.csv")
    expect(on_map.locator(".cover output").last).to_contain_text("wrong.csv: line 5: other.png")


def test_labels_are_counted_and_their_cover_is_of_what_was_seen(on_map: Page) -> None:
    on_map.get_by_role("button", name="Mosaic", exact=True).click()
    until_drawn(on_map)
    stop_clock(on_map)
    on_map.get_by_role("button", name="Area", exact=True).click()
    for number, size in enumerate((0.04, 0.02), start=1):
        box = box_of(on_map.locator(".map-stage"))
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] * (0.35 + 0.1 * number)
        for dots, (i, k) in enumerate(((0, 0), (1, 0), (1, 1), (0, 1)), start=1):
            on_map.mouse.click(x + i * size * box["width"], y + k * size * box["width"])
            expect(on_map.locator(".map-overlay .dot:not([data-id])")).to_have_count(dots)
        on_map.locator("#map").get_by_role("button", name="Finish").click()
        on_map.get_by_label(f"Label of measurement {number}", exact=True).fill("Acropora")
        on_map.get_by_label(f"Label of measurement {number}", exact=True).press("Tab")
    cells = on_map.locator("#map .measure-table .tally tbody td")
    count, plan, of_seen, of_outlined = cells.all_inner_texts()[1:5]
    assert (count, of_outlined) == ("2", "100 %")
    assert 0 < float(of_seen.split()[0]) < 100 and float(plan.split()[0]) > 0
    on_map.get_by_role("button", name="Remove the last measurement labeled Acropora").click()
    expect(on_map.locator("#map .measures").first.locator("tbody tr")).to_have_count(1)


def test_an_outline_that_crosses_itself_is_kept_so_that_a_corner_can_be_moved(on_map: Page) -> None:
    on_map.get_by_role("button", name="Terrain", exact=True).click()
    on_map.locator(".map-bar").wait_for()
    stop_clock(on_map)
    on_map.get_by_role("button", name="Area", exact=True).click()
    dots = on_map.locator(".map-overlay .dot:not([data-id])")
    for count, (x, y) in enumerate(((0.46, 0.4), (0.54, 0.4), (0.46, 0.5), (0.54, 0.5)), start=1):
        box = box_of(on_map.locator(".map-stage"))
        on_map.mouse.click(box["x"] + box["width"] * x, box["y"] + box["height"] * y)
        expect(dots).to_have_count(count)
    finish = on_map.locator("#map").get_by_role("button", name="Finish")
    finish.click()
    expect(on_map.locator("#map .measuring .readout").first).to_contain_text("crosses itself")
    expect(dots).to_have_count(4)
    on_map.locator("#map").get_by_role("button", name="Undo").click()
    expect(dots).to_have_count(3)
    finish.click()
    expect(on_map.locator("#map .measures tbody tr")).to_have_count(1)


def test_a_map_has_a_bar_of_length_and_no_north_where_none_is_known(on_map: Page) -> None:
    on_map.get_by_role("button", name="Terrain", exact=True).click()
    at_rest(on_map)
    # at once: the bar is drawn anew with the map
    text, width = on_map.locator(".map-bar").evaluate(
        "bar => [bar.innerText, bar.getBoundingClientRect().width]"
    )
    value, unit = text.split()
    length_m = float(value) / (100 if unit == "cm" else 1)
    found, places = on_map.locator(".found h2"), [""]
    for dx in (0.0, width):

        def finds_another(dx: float = dx) -> bool:
            box = box_of(on_map.locator(".map-flat"))
            x, y = box["x"] + box["width"] / 2 + dx / 2, box["y"] + box["height"] / 2
            # again where a busy machine took it for a drag; on a clock that stands a double click
            on_map.mouse.click(x, y)
            on_map.wait_for_timeout(500)
            return bool(found.count()) and found.inner_text() != places[-1]

        until(on_map, finds_another)
        places.append(found.inner_text())
    (x1, y1), (x2, y2) = (map(float, re.findall(r"-?[0-9.]+", place)[1:3]) for place in places[1:])
    assert np.hypot(x2 - x1, y2 - y1) == pytest.approx(length_m / 2, abs=0.02)
    assert on_map.locator(".map-north").count() == 0
    expect(on_map.locator(".map-marks .clicked")).to_have_count(1)


@pytest.mark.parametrize("points", [2, 2000])
def test_the_places_of_a_long_track_are_loaded_where_it_is_near(
    new_context: Callable[..., BrowserContext],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    points: int,
) -> None:
    monkeypatch.setattr("stereo_seecolor.report.frame_blocks.TRACK_POINTS", points)
    mapped_run(tmp_path / "out")
    page, asked = new_context().new_page(), list[str]()
    page.on("request", lambda request: asked.append(request.url))
    page.goto(f"{(tmp_path / 'out/index.html').as_uri()}#map")
    canvas = page.locator(".map-stage canvas[data-triangles]:not([data-triangles='0'])")
    box = box_of(canvas)
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    for _ in range(12):
        page.mouse.wheel(0, -240)
        page.wait_for_timeout(50)
    expect(canvas).to_have_attribute("aria-busy", "false")
    blocks = [url for url in asked if "/page/frames/" in url]
    assert [Path(url).name for url in blocks] == (["0.js"] if points == 2 else [])
