"""The page in a real browser: opened from a file, nothing leaves it, and what is clicked
happens.
"""

import csv
import json
import re
import shutil
import zlib
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from browser_pages import (
    NASTY,
    SHOWN,
    box_of,
    browser,
    measuring,
    new_context,
    opened,
    out,
    stop_clock,
    stored,
    until,
    window_place,
)
from conftest import Dive
from page_scripts import dive_of
from playwright.sync_api import (
    BrowserContext,
    Page,
    expect,
)

from stereo_seecolor.color.white_point import white_errors, with_white
from stereo_seecolor.commands.report import report
from stereo_seecolor.commands.run import run
from stereo_seecolor.config.file import load_config
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.extras.reef.measure import measure
from stereo_seecolor.files.srgb import decode_srgb
from stereo_seecolor.records import Water
from stereo_seecolor.report.templates import script

pytestmark = [pytest.mark.browser, pytest.mark.slow]


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


def clicked(page: Page, *places: tuple[float, float]) -> None:
    """Click places of the picture to measure in, pixels of an image of 176x128."""
    for x, y in places:
        page.mouse.click(*window_place(page, x, y))


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
        # the page rounds ranges to a part of their standard errors
        rounding = 0.02 * theirs.std
        assert mine["value"] == pytest.approx(theirs.value, rel=3e-4, abs=rounding)
        assert (mine["surface"] or 0) == pytest.approx(theirs.surface or 0, rel=3e-4, abs=rounding)
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
    page.evaluate("""() => {
        globalThis.drawn = new Set();
        const { prototype } = CanvasRenderingContext2D, { fillText } = prototype;
        prototype.fillText = function (text, ...place) {
            drawn.add(text);
            fillText.call(this, text, ...place);
        };
    }""")
    page.set_viewport_size({"width": 1000, "height": 900})  # draws them again
    until(page, "drawn.has('frame, counted from 0')")
    plot = page.locator(".plot .u-over").first
    box = box_of(plot)
    plot.click(position={"x": box["width"] - 4, "y": 40})
    until(page, "location.hash.startsWith('#frames/')")
    expect(page.locator(".frame-name")).to_have_text(NASTY)


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
