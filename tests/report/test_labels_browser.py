"""Random points, labels and outlines on the map of the page, in a real browser."""

import csv
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from browser_pages import (
    box_of,
    browser,
    map_in,
    mapped,
    new_context,
    on_map,
    stop_clock,
    stored,
    until,
    until_drawn,
)
from playwright.sync_api import (
    BrowserContext,
    Locator,
    Page,
    expect,
)

from stereo_seecolor.commands.report import report
from stereo_seecolor.extras.reef.measure import measure
from stereo_seecolor.extras.reef.metrics import metrics

pytestmark = [pytest.mark.browser, pytest.mark.slow]


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


def measure_points(page: Page, *places: float) -> None:
    """Measure points of the mosaic, from 0 to 1 of its width, at half of its height."""
    page.get_by_role("button", name="Mosaic", exact=True).click()
    until_drawn(page)
    stop_clock(page)
    page.get_by_role("button", name="Point", exact=True).click()
    for number, x in enumerate(places, start=1):
        box = box_of(page.locator(".map-stage"))
        page.mouse.click(box["x"] + box["width"] * x, box["y"] + 0.5 * box["height"])
        expect(page.locator("#map .measures tbody tr")).to_have_count(number)


@pytest.mark.parametrize(("width", "height"), [(1400, 900), (390, 844)])
def test_labels_that_are_typed_one_after_the_other_all_stay(
    new_context: Callable[..., BrowserContext], mapped: Path, width: int, height: int
) -> None:
    """By mouse from field to field, by Tab, and without leaving the last field."""
    page = new_context(width, height).new_page()
    page.goto(f"{(mapped / 'index.html').as_uri()}#map")
    measure_points(page, 0.4, 0.5, 0.6)
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
    measure_points(on_map, 0.4, 0.6)
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
