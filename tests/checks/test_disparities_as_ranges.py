"""Range maps that hold disparities: named by the water and by the steps that they are stored in."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from stereo_seecolor.checks.range_maps import disparities
from stereo_seecolor.checks.sample import DiveImages
from stereo_seecolor.config import RunConfig
from stereo_seecolor.inputs.pairing import Pair

Array = NDArray[np.float64]
MILLIMETERS = 1000
FOCAL_BASELINE_PX_M = 60.0
SLANTED_M = np.linspace(1, 4, 320)[:, None] * np.ones((1, 480))
RED_LEAST = np.array([0.06, 0.12, 0.5])
"""1/m, of R, G, B: brown water."""
CLEAR = np.array([0.5, 0.12, 0.15])


def seen(range_m: Array, beta: Array, veil: Array) -> NDArray[np.uint8]:
    """BGR of a textured gray bottom behind water, sRGB by a power."""
    texture = np.random.default_rng(4).uniform(0.15, 0.75, range_m.shape)
    through = np.exp(-beta * range_m[..., None])
    light = cv2.GaussianBlur(texture, (0, 0), 1.5)[..., None] * through + veil * (1 - through)
    return np.round(255 * light[..., ::-1] ** (1 / 2.2)).astype(np.uint8)


def folder(
    root: Path, beta: Array, maps: Array, veil: Array, true_m: Array = SLANTED_M
) -> DiveImages:
    pairs = []
    for name in ("images", "maps"):
        (root / name).mkdir()
    for number in range(2):
        image, of_it = root / "images" / f"{number}.png", root / "maps" / f"{number}.tiff"
        cv2.imwrite(str(image), seen(true_m, beta, veil))
        cv2.imwrite(str(of_it), maps)
        pairs.append(Pair(f"{number}", image, of_it))
    return DiveImages(pairs, RunConfig())


VEIL = np.array([0.05, 0.3, 0.4])
DISPARITY_PX = FOCAL_BASELINE_PX_M / SLANTED_M


@pytest.mark.parametrize(
    ("maps", "named"),
    [
        (SLANTED_M.astype(np.float32), ""),
        (np.round(SLANTED_M * MILLIMETERS).astype(np.uint16), ""),
        (np.round(DISPARITY_PX * 16).astype(np.uint16), "images are redder"),
        ((1 / SLANTED_M).astype(np.float32), "images are redder"),  # inverse depth
    ],
)
def test_larger_values_of_what_is_near_are_named(maps: Array, named: str, tmp_path: Path) -> None:
    found = disparities(folder(tmp_path, CLEAR, maps, VEIL))
    assert found.wrong == ({"ranges", "colors"} if named else frozenset())
    assert named in " ".join(found.notes)


def test_maps_upside_down_are_no_disparities(tmp_path: Path) -> None:
    x, y = np.meshgrid(np.linspace(0, 1, 480), np.linspace(0, 1, 320))
    rocks_m = 1 + 3 * y**2 + np.sin(9 * x) * (0.2 + y)
    upside_down = rocks_m[::-1].astype(np.float32)
    (note,) = disparities(folder(tmp_path, CLEAR, upside_down, VEIL, rocks_m)).notes
    assert "is upside down relative to its image" in note


def test_disparities_of_a_plane_may_be_ranges_upside_down(tmp_path: Path) -> None:
    (note,) = disparities(folder(tmp_path, CLEAR, SLANTED_M[::-1].astype(np.float32), VEIL)).notes
    assert "holds disparities or inverse depth, or, as likely, ranges upside down" in note


@pytest.mark.parametrize("veil", [VEIL[::-1].copy(), np.full(3, 0.2)])
def test_ranges_in_brown_water_are_ranges(veil: Array, tmp_path: Path) -> None:
    """What is far is redder there, and has less contrast all the same."""
    assert not disparities(folder(tmp_path, RED_LEAST, SLANTED_M.astype(np.float32), veil)).notes


def test_sixteenths_of_a_pixel_are_disparities_in_any_water(tmp_path: Path) -> None:
    none = np.zeros(3)
    sixteenths = (np.round(DISPARITY_PX * 16) / 16).astype(np.float32)
    (note,) = disparities(folder(tmp_path, none, sixteenths, none)).notes
    assert "whole numbers of 1/16 of a pixel" in note


@pytest.mark.slow
def test_correct_ends_with_code_3(cli, tmp_path: Path) -> None:
    folder(tmp_path, CLEAR, np.round(DISPARITY_PX * 16).astype(np.uint16), VEIL)
    words = ["--images", tmp_path / "images", "--range", tmp_path / "maps"]
    code, printed, said = cli("correct", *words, "--out", tmp_path / "out")
    assert code == 3
    assert "holds disparities or inverse depth" in " ".join((printed + said).split())
