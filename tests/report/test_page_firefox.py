"""The page in Firefox, where it is installed: it opens from a file, nothing leaves it, and its
parts work.
"""

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from browser_pages import RANGES_ARE_READ
from conftest import Dive
from firefox import firefox

from stereo_seecolor.commands.report import report
from stereo_seecolor.commands.run import run
from stereo_seecolor.config.file import load_config

pytestmark = [pytest.mark.browser, pytest.mark.slow]

FIREFOX = os.environ.get("FIREFOX") or shutil.which("firefox-esr") or shutil.which("firefox")


def test_the_page_works_in_firefox(make_dive: Callable[..., Dive], tmp_path: Path) -> None:
    if FIREFOX is None:
        pytest.skip("Firefox is not installed (apt-get install firefox-esr, or FIREFOX=PATH)")
    dive = make_dive(2)
    run(
        dive.root / "L",
        dive.root / "R",
        dive.root / "cam.yaml",
        tmp_path / "out",
        load_config(None, []),
    )
    report(tmp_path / "out")
    page = (tmp_path / "out/index.html").as_uri()
    with firefox(FIREFOX, tmp_path / "profile") as browser:
        browser.open(page)
        browser.until(
            "[...document.querySelectorAll('.examples img')].every(image => image.naturalWidth > 0)"
        )
        browser.ask("location.hash = '#frames/0001'")
        browser.until("document.querySelector('.frame-name')?.textContent === '0001'")
        browser.until("document.querySelector('.stage .slider img').naturalWidth > 0")
        browser.ask(
            "[...document.querySelectorAll('#frames .choice button')].find(each => "
            "each.textContent === 'Range').click()"
        )
        browser.until("document.querySelector('.stage canvas')?.width > 0")
        browser.ask(
            "[...document.querySelectorAll('#frames .choice button')].find(each => "
            "each.textContent === 'Measure').click()"
        )
        browser.until("document.querySelector('.overlay')?.previousSibling.naturalWidth > 0")
        browser.until(RANGES_ARE_READ)
        browser.ask("document.querySelector('.overlay').scrollIntoView({ behavior: 'instant' })")
        place = "(r => [r.left + 0.4 * r.width, r.left + 0.6 * r.width, r.top + 0.4 * r.height])"
        x1, x2, y = (
            item["value"]
            for item in browser.ask(
                f"{place}(document.querySelector('.overlay').getBoundingClientRect())"
            )
        )
        browser.click((x1, y), (x2, y), (x2, y))
        browser.until("document.querySelectorAll('.measures tbody tr').length === 1")
        assert browser.ask("JSON.parse(Object.values(localStorage)[0])[0].places.length") == 2
        browser.ask("location.hash = '#plots'")
        browser.until("document.querySelectorAll('.plot canvas').length > 2")
        assert browser.complaints == []
