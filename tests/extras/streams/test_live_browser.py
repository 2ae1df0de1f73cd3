"""The preview page of a live dive, in a real browser."""

import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from browser_pages import browser, new_context
from playwright.sync_api import BrowserContext

from calibration.formats import load_rig
from stereo_seecolor.config import InputConfig, RunConfig
from stereo_seecolor.extras.streams.live.folder_watch import FolderWatch
from stereo_seecolor.extras.streams.live.preview import Preview, served
from stereo_seecolor.extras.streams.live.processing import LiveProcessor
from stereo_seecolor.extras.streams.live.session import LiveCounts
from stereo_seecolor.pipeline import Pipeline

pytestmark = [pytest.mark.browser, pytest.mark.slow]


@pytest.mark.parametrize("host", ["127.0.0.1", "127.0.0.2"])
def test_the_page_shows_what_arrives(
    make_dive,
    new_context: Callable[..., BrowserContext],
    tmp_path: Path,
    host: str,
) -> None:
    """On the second address the page's own path begins with a token, and all that it loads must
    too.
    """
    dive = make_dive(1)
    source = FolderWatch(dive.root / "L", dive.root / "R", InputConfig())
    pair = source.newest()
    assert pair is not None
    counts = LiveCounts(waiting="the right camera")
    preview = Preview(counts)
    page, complaints = new_context(1000, 700).new_page(), []
    page.on("pageerror", lambda error: complaints.append(str(error)))
    with served(preview, 0, host) as address:
        page.goto(address)
        _until(lambda: page.inner_text("#state") == "waiting for the right camera")
        preview.update(
            LiveProcessor(
                Pipeline(load_rig(dive.root / "cam.yaml"), RunConfig()), source.read
            ).process(pair)
        )
        counts.waiting, counts.done, counts.reduced = "", 1, "matched at 1/2 of the size"
        counts.images_s.append(0.08)
        counts.last_error = "<img src=x onerror=alert(1)>"
        _until(lambda: page.inner_text("#state") == "0000")
        for shown_image in ("corrected", "range"):
            _until(
                lambda name=shown_image: (
                    page.evaluate("name => document.getElementById(name).naturalWidth", name) == 176
                )
            )
        assert page.inner_text("#reduced") == "matched at 1/2 of the size"
        assert page.inner_text("#line") == "A pair failed: <img src=x onerror=alert(1)>"
        assert "0.08 s" in page.inner_text("#facts")
        assert "Light that remains after 1 m" in page.inner_text("#pair")
        style = "e => getComputedStyle(e).display"
        assert page.eval_on_selector("#facts", style) == "grid", "in the style of a dive's page"
        shown = cv2.imdecode(np.frombuffer(page.screenshot(), np.uint8), cv2.IMREAD_COLOR)
        assert shown.std() > 20
    _until(lambda: page.inner_text("#state") == "the program has ended")
    assert not complaints


def _until(found, seconds: float = 120.0) -> None:
    end = time.monotonic() + seconds
    while not found():
        assert time.monotonic() < end
        time.sleep(0.1)
