"""Frames that are almost black or overexposed are named in frames.csv; others, highlights and lit
things in the dark, are not.
"""

import csv
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import Dive

from stereo_seecolor.checks.exposure import exposure_warnings

DARK = "the frame is almost black: its colors are mostly noise"
RANGE_M = np.full((80, 100), 2.0, np.float32)


def gray(value: int, patch: int, fraction: float) -> np.ndarray:
    """A frame of one value, that fraction of its rows of another."""
    image = np.full((*RANGE_M.shape, 3), value, np.uint8)
    image[: round(fraction * len(image))] = patch
    return image


@pytest.mark.parametrize(
    ("image", "said"),
    [
        (gray(6, 12, 0.3), (DARK,)),
        (gray(6, 60, 0.05), (DARK,)),
        (gray(6, 60, 0.2), ()),
        (gray(90, 255, 0.05), ()),
        (
            gray(90, 255, 0.5),
            (
                "overexposed: 50% of the frame is clipped by the camera, and its color is "
                "beyond recovery",
            ),
        ),
    ],
)
def test_what_is_said_of_an_exposure(image: np.ndarray, said: tuple[str, ...]) -> None:
    assert exposure_warnings(image, RANGE_M, "srgb") == said


def test_one_channel_clips_a_pixel() -> None:
    image = gray(90, 90, 0)
    image[..., 2] = 255
    assert "100%" in exposure_warnings(image, RANGE_M, "srgb")[0]


def test_what_has_no_range_does_not_count() -> None:
    range_m = RANGE_M.copy()
    range_m[:40] = np.nan
    assert exposure_warnings(gray(90, 255, 0.5), range_m, "srgb") == ()
    assert exposure_warnings(gray(0, 0, 0), RANGE_M * np.nan, "srgb") == ()


@pytest.mark.slow
def test_frames_of_a_dive_are_named(make_dive: Callable[..., Dive], cli, tmp_path: Path) -> None:
    dive = make_dive(3)
    for path in sorted(dive.root.rglob("*.png")):
        factor = {"0001": 0.05, "0002": 4.0}.get(path.stem, 1.0)
        cv2.imwrite(str(path), np.clip(cv2.imread(str(path)) * factor, 0, 255).astype(np.uint8))
    code, _, said = cli(*dive.command(tmp_path / "out", "--set", "color.lock=survey"))
    assert code == 0, said
    with (tmp_path / "out/frames.csv").open(newline="") as file:
        usual, dark, bright = (row["warnings"] for row in csv.DictReader(file))
    assert (DARK in dark, "overexposed: " in bright) == (True, True)
    assert not any(word in usual for word in (DARK, "overexposed"))
