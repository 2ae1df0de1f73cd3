"""Gaps of a map say why nothing is known there."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rasterio
from mapping_scene import CONFIG, PAIR, flat_frame, track

from stereo_seecolor.mapping.raster.block_raster import BlockRaster
from stereo_seecolor.mapping.raster.gaps import (
    BLANK,
    HIT,
    THROUGH,
    WIDEST_M,
    Reason,
    gap_cells,
    reasons_of,
)
from stereo_seecolor.mapping.raster.grid import Grid
from stereo_seecolor.mapping.survey_map import build_map
from stereo_seecolor.records import SurveyFrame

BLOCK = np.s_[50:75, 65:95]
"""Pixels in the middle of an image: 19 x 22 cm of the ground."""
SMALL = np.s_[57:70, 73:86]
"""In it: with its sides too small to be taken for the bottom."""


def with_range(i: int, range_of: Callable[[np.ndarray], np.ndarray | float]) -> SurveyFrame:
    frame = flat_frame(i)
    range_m = frame.range_m.copy()
    range_m[BLOCK] = range_of(range_m[BLOCK])
    return replace(frame, range_m=range_m)


def hidden(i: int) -> SurveyFrame:
    """A small thing 0.6 m above the ground, which is not taken for the bottom."""
    return with_range(i, lambda range_m: 0.6 * range_m)


def blank(i: int) -> SurveyFrame:
    return with_range(i, lambda range_m: np.nan)


def uncertain(i: int) -> SurveyFrame:
    frame = flat_frame(i)
    std_m = frame.range_std_m.copy()
    std_m[BLOCK] = 0.4
    return replace(frame, range_std_m=std_m)


def moving(i: int) -> SurveyFrame:
    """Something small stands 0.28 m above the ground in half of the images, and the others show
    what is below it, without certainty.
    """
    if i % 2:
        return uncertain(i)
    frame = blank(i)
    frame.range_m[SMALL] = flat_frame(i).range_m[SMALL] * (1 - 0.28 / 1.5)
    return frame


@pytest.mark.slow
@pytest.mark.parametrize(
    ("frame", "reason"),
    [
        (hidden, Reason.NOT_SEEN),
        (blank, Reason.NO_RANGE),
        (uncertain, Reason.UNCERTAIN),
        (moving, Reason.DISAGREE),
    ],
)
def test_a_gap_says_why(
    tmp_path: Path, frame: Callable[[int], SurveyFrame], reason: Reason
) -> None:
    build_map([frame(i) for i in range(4)], PAIR, tmp_path, CONFIG, track(4, step_m=0.0))
    with rasterio.open(tmp_path / "gaps.tif") as gaps, rasterio.open(tmp_path / "dem.tif") as dem:
        codes, heights, nodata = gaps.read(1), dem.read(1), gaps.nodata
        assert (gaps.transform, gaps.shape) == (dem.transform, dem.shape)
        row, column = gaps.index(0.0, 0.0)
    assert nodata == 0 and not codes[np.isfinite(heights)].any()
    middle = codes[row - 1 : row + 1, column - 1 : column + 1]
    assert (middle == reason).all()
    assert (codes > 0).sum() == pytest.approx(0.19 * 0.22 / CONFIG.dem_m**2, rel=0.5)


@pytest.mark.parametrize(
    ("std_m", "least", "most"), [(0.02, 0.0, 0.05), (0.1, 0.4, 0.7), (0.2, 1, 1)]
)
def test_ranges_too_uncertain_for_the_voxels_are_a_problem_of_the_map(
    tmp_path: Path, std_m: float, least: float, most: float
) -> None:
    def noisy(i: int) -> SurveyFrame:
        frame, rng = flat_frame(i), np.random.default_rng(i)
        off_m = rng.normal(0, std_m, frame.range_m.shape)
        stds_m = np.full_like(frame.range_std_m, std_m)
        range_m = (frame.range_m + off_m).astype(np.float32)
        return replace(frame, range_m=range_m, range_std_m=stds_m)

    made = build_map([noisy(0), noisy(1)], PAIR, tmp_path, CONFIG, track(2, step_m=0.0))
    said = [text for text in made.problems if "of the measured ground is missing" in text]
    assert bool(said) == (least > 0) == any("voxels of 0.02 m" in text for text in made.warnings)
    assert least <= made.missing_fraction <= most
    description = json.loads((tmp_path / "map.json").read_text())
    assert description["missing_fraction"] == made.missing_fraction


def test_what_lies_outside_of_the_map_is_no_gap(tmp_path: Path) -> None:
    """Known ground on three sides makes a gap of what lies between, where it is narrow enough."""
    terrain = BlockRaster(tmp_path, Grid(0.0, 4.0, 0.02, (200, 200)), 1, np.float32, np.nan)
    heights = np.full((1, 200, 200), np.nan, np.float32)
    heights[0, 20:120, 20:120] = 1.0
    heights[0, 60:70, 60:70] = np.nan  # a hole
    heights[0, 100:120, 80:90] = np.nan  # a bay
    heights[0, 40, 40] = np.nan  # closed, as in the mosaic
    window = slice(0, 200), slice(0, 200)
    terrain.write(*window, heights)
    places, points = gap_cells(terrain, *window)
    found = np.zeros((200, 200), bool)
    found[tuple(places.T)] = True
    expected = np.zeros_like(found)
    expected[60:70, 60:70] = expected[100:120, 80:90] = True
    corners = np.abs(np.argwhere(found != expected))
    assert len(corners) <= 8  # rounded off
    assert np.allclose(points[:, 2], 1.0)
    assert int(WIDEST_M / 0.02) == 50


def test_the_strongest_evidence_decides() -> None:
    evidence = np.array(
        [[0, 0], [THROUGH, 0], [BLANK, THROUGH], [HIT, THROUGH], [HIT | THROUGH, BLANK]], np.uint8
    )
    assert reasons_of(evidence).tolist() == [
        Reason.NOT_SEEN,
        Reason.NOT_SEEN,
        Reason.NO_RANGE,
        Reason.UNCERTAIN,
        Reason.DISAGREE,
    ]
