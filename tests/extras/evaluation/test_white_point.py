"""A white point that is hardly known is named, in every place where a user may see it; a spot of
known color settles it.
"""

import csv
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import Cli, Dive

from stereo_seecolor.color.white_point import DOUBT, white_doubt, white_errors, with_white
from stereo_seecolor.extras.evaluation.charts.chart_white import doubts_of, seen_whites
from stereo_seecolor.extras.evaluation.charts.targets import targets_of
from stereo_seecolor.extras.evaluation.score_texts import water_text
from stereo_seecolor.extras.evaluation.water import ChartReading, MeasuredWater
from stereo_seecolor.files.srgb import LUMINANCE, decode_srgb
from stereo_seecolor.records import Water

WHITE = np.array([0.25, 0.6, 0.5])


def some_water(error: tuple[float, float, float] | None = None) -> Water:
    """error: standard errors of the logarithms of its white point's color."""
    zero, one, y = np.zeros(3), np.ones(3), np.array([0.4, 0.1, 0.08])
    water = Water(
        np.array([0.01, 0.03, 0.04]),
        0.3 * one,
        zero,
        one,
        zero,
        zero,
        y,
        zero,
        WHITE,
        input_encoding="linear",
    )
    return with_white(water, WHITE, np.array(error)) if error else water


def test_errors_of_ratios_follow_from_those_of_colors() -> None:
    logs = np.random.default_rng(2).multivariate_normal(
        np.zeros(3), [[0.09, 0.02, 0.01], [0.02, 0.04, 0.03], [0.01, 0.03, 0.06]], 10**5
    )
    colors = logs - logs.mean(axis=1, keepdims=True)
    true = (colors - colors[:, 1:2])[:, [0, 2]].std(axis=0)
    np.testing.assert_allclose(white_errors(some_water(tuple(colors.std(axis=0)))), true, rtol=0.01)


def test_a_spot_gives_ratios_with_the_errors_of_ratios() -> None:
    spot = ChartReading("0001", "sand at pixel 9, 9", 2.0, 0.0, np.nan, np.nan)
    text = water_text(MeasuredWater(Path("w.json"), some_water((0.05, 0.04, 0.04)), (spot,)))
    assert "red 0.417 +- 8.1%, blue 0.833 +- 6.2%" in text
    assert "matrix" not in text, "a spot has no patches"


@pytest.mark.parametrize(
    ("error", "doubted"),
    [
        ((0.3, 0.15, 0.2), True),
        ((0.1, 0.1, 0.1), True),
        ((0.03, 0.03, 0.03), False),
        ((np.nan,) * 3, False),
    ],
)
def test_a_white_point_known_to_worse_than_8_percent_is_doubted(
    error: tuple[float, float, float], doubted: bool
) -> None:
    line = white_doubt(some_water(error))
    assert bool(line) == doubted
    assert not line or ("--chart" in line and "--white FRAME:x,y" in line and "\n" not in line)
    assert white_doubt(some_water()) == "", "a water without standard errors says nothing"


def test_another_white_is_as_bright() -> None:
    before = replace(some_water(), exposure=1.5)
    after = with_white(before, np.array([2.0, 1.0, 1.0]), np.full(3, 0.02))
    assert np.log(after.white).mean() == pytest.approx(np.log(before.white).mean())
    assert before.exposure and after.exposure
    # of what was gray of light 1 before
    gray = after.exposure / before.exposure * before.white / after.white
    assert gray @ LUMINANCE == pytest.approx(1.0)


@pytest.mark.parametrize(("kind", "reflectance"), [("white", (1, 1, 1)), ("sand", (1.17, 1, 0.77))])
def test_a_spot_of_known_color_gives_the_white(
    kind: str, reflectance: tuple[float, float, float]
) -> None:
    water, range_m = some_water(), np.full((96, 128), 2.0, np.float32)
    light = np.random.default_rng(1).uniform(0.2, 0.9, (96, 128, 3))
    light[40:60, 50:70] = 0.5 * np.array(reflectance)
    seen = light * WHITE * water.attenuation(np.array(2.0)) + water.backscatter(np.array(2.0))
    image = np.round(seen * 65535).astype(np.uint16)
    targets = targets_of([{kind: np.array([60.0, 50.0])}], image, range_m)
    (found,) = seen_whites(
        "0001", targets, image, range_m, with_white(water, np.ones(3), np.full(3, 0.3))
    )
    np.testing.assert_allclose(found.white, np.log(WHITE) - np.log(WHITE).mean(), atol=0.01)
    assert found.target == f"{kind} at pixel 60, 50"
    assert 0.02 < found.error < 0.04


@pytest.mark.parametrize(
    ("spot", "said"),
    [
        ((0.95, 0.95, 0.95), ""),
        ((0.1, 0.1, 0.1), "of the frame is brighter, with the water removed"),
        ((0.9, 0.45, 0.45), "its red is 2.0"),
    ],
    ids=["white", "dark", "red"],
)
def test_a_spot_that_its_frame_contradicts_is_doubted(
    spot: tuple[float, float, float], said: str
) -> None:
    water = with_white(some_water(), WHITE, np.full(3, 0.1))
    range_m = np.full((96, 128), 2.0, np.float32)
    light = np.random.default_rng(1).uniform(0.05, 0.6, (96, 128, 3))
    light[40:60, 50:70] = spot
    seen = light * water.white * water.attenuation(np.array(2.0)) + water.backscatter(np.array(2.0))
    image = np.round(seen * 65535).astype(np.uint16)
    targets = targets_of([{"white": np.array([60.0, 50.0])}], image, range_m)
    (found,) = seen_whites("0001", targets, image, range_m, water)
    doubts = " ".join(doubts_of(found, water))
    assert bool(doubts) == bool(said) and said in doubts


@pytest.mark.slow
def test_the_doubt_is_said_and_a_spot_settles_it(
    make_dive: Callable[..., Dive], cli: Cli, tmp_path: Path
) -> None:
    dive = make_dive()
    one_water = ("--set", "color.lock=survey")
    _, printed, _ = cli(*dive.command(tmp_path / "out", *one_water))
    rows = list(csv.DictReader((tmp_path / "out/frames.csv").read_text().splitlines()))
    assert printed.count(DOUBT) == 1, "once for the dive, not as what went wrong with its frames"
    assert f"note: {DOUBT}" in " ".join(printed.split())
    assert all(DOUBT in row["warnings"] for row in rows)
    page = (tmp_path / "out/index.html").read_text("utf-8")
    assert "Good: no problem was detected." not in page
    assert page.lower().count(DOUBT) == 1
    _, found, _ = cli("water", str(tmp_path / "out"), "--white", "0001:88,64")
    assert "white at pixel 88, 64" in found
    measured = tmp_path / "out/water_measured.json"
    cli(*dive.command(tmp_path / "again", *one_water, "--water", str(measured)))
    rows = list(csv.DictReader((tmp_path / "again/frames.csv").read_text().splitlines()))
    assert not any(DOUBT in row["warnings"] for row in rows)
    assert len({row["exposure"] for row in rows}) == 1
    shown = cv2.imread(str(tmp_path / "again/corrected/0001.png"))[62:67, 86:91] / 255.0
    spot = decode_srgb(shown).mean(axis=(0, 1))
    assert np.ptp(np.log(spot)) < 0.06, "it comes out gray"


@pytest.mark.slow
def test_a_spot_that_is_not_there_is_named(
    make_dive: Callable[..., Dive], cli: Cli, tmp_path: Path
) -> None:
    dive = make_dive()
    cli(*dive.command(tmp_path / "out", "--set", "color.lock=survey"))
    for place, said in (
        ("0001", "needs FRAME:x,y"),
        ("9:1,2", "no frame '9'"),
        ("0001:9999,1", "reaches outside the corrected image"),
    ):
        code, _, error = cli("water", tmp_path / "out", "--white", place)
        assert code == 1 and said in " ".join(error.split())
