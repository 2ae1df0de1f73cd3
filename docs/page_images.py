"""Pictures of the page for the documentation, in Chromium: python docs/page_images.py OUT, where
OUT is a run of the sample dive.

The run must have been fused, and stereo-seecolor report must have made its page whole.
"""

import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from playwright.sync_api import Browser, Page, sync_playwright

IMAGES = Path(__file__).parent / "images"
SOFTWARE = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
LAPTOP, TABLET, PHONE = (1280, 860), (820, 1100), (390, 844)
QUALITY = 82


def _measured(page: Page) -> None:
    """A length and an area on the map."""
    box = page.locator(".map-stage").bounding_box()
    assert box
    for kind, places in (
        ("Length", ((0.44, 0.5), (0.53, 0.62))),
        ("Area", ((0.46, 0.7), (0.53, 0.7), (0.5, 0.78))),
    ):
        page.get_by_role("button", name=kind, exact=True).click()
        for x, y in places:
            page.mouse.click(box["x"] + x * box["width"], box["y"] + y * box["height"])
            page.wait_for_timeout(1500)
        page.locator("#map").get_by_role("button", name="Finish").click()
    page.wait_for_timeout(1000)


def _squares(page: Page) -> None:
    page.get_by_role("button", name="Mosaic").click()
    page.wait_for_timeout(1500)
    page.get_by_role("button", name="Hillshade").click()
    page.locator("#map select").first.select_option("1")
    page.wait_for_timeout(2500)


def _nothing(page: Page) -> None:
    """As it opens."""


PICTURES: dict[str, tuple[str, tuple[int, int], str, Callable[[Page], None]]] = {
    "page_overview": ("overview", LAPTOP, "light", _nothing),
    "page_overview_phone": ("overview", PHONE, "dark", _nothing),
    "page_map": ("map", LAPTOP, "light", _nothing),
    "page_map_measured": ("map", (1280, 1100), "light", _measured),
    "page_map_squares": ("map", TABLET, "dark", _squares),
}


def take(browser: Browser, address: str, name: str) -> None:
    """Write one picture."""
    place, (width, height), scheme, then = PICTURES[name]
    context = browser.new_context(viewport={"width": width, "height": height}, color_scheme=scheme)  # type: ignore[arg-type]
    page = context.new_page()
    page.goto(f"{address}#{place}")
    page.wait_for_timeout(6000)
    then(page)
    image = cv2.imdecode(np.frombuffer(page.screenshot(), np.uint8), cv2.IMREAD_COLOR)
    cv2.imwrite(str(IMAGES / f"{name}.jpg"), image, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    context.close()


if __name__ == "__main__":
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=list(SOFTWARE)
        )
        for wanted in PICTURES:
            take(chromium, (Path(sys.argv[1]).resolve() / "index.html").as_uri(), wanted)
        chromium.close()
