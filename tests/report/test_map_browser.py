"""The map of the page in a real browser: what is drawn, found by a click and measured."""

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from browser_pages import (
    FLAT_BGR,
    SHOWN,
    box_of,
    browser,
    map_in,
    mapped,
    mapped_run,
    new_context,
    on_map,
    stop_clock,
    stored,
    until,
    until_drawn,
)
from mapping_scene import flat_frame, track
from playwright.sync_api import (
    BrowserContext,
    Locator,
    Page,
    expect,
)

from stereo_seecolor.commands.report import report
from stereo_seecolor.extras.reef.measure import measure
from stereo_seecolor.records import SurveyFrame
from stereo_seecolor.report.map_mesh import RIM_SHADE

pytestmark = [pytest.mark.browser, pytest.mark.slow]


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


def test_a_map_has_a_bar_of_length_and_no_north_where_none_is_known(on_map: Page) -> None:
    on_map.get_by_role("button", name="Terrain", exact=True).click()
    on_map.locator(".map-bar").wait_for()
    at_rest(on_map)
    # in one step: the bar is made anew with each drawing, and one that is gone is 0 wide
    text, width = on_map.evaluate(
        """() => {
            const bar = document.querySelector(".map-bar");
            return [bar.innerText, bar.getBoundingClientRect().width];
        }"""
    )
    assert width > 0
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
