"""Particles in the water, hot pixels and highlights in the left image."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from calibration.formats import load_rig
from stereo_seecolor.config import InputConfig, RunConfig
from stereo_seecolor.files.srgb import decode_srgb, encode_srgb
from stereo_seecolor.inputs.images import read_image
from stereo_seecolor.matching.particles import without_particles
from stereo_seecolor.pipeline import Pipeline
from stereo_seecolor.records import RangeMap, StereoFrame

REEF = Path(__file__).parents[2] / "data_samples/reef"
SHIFT = 12
SIZE = (240, 320)


def surface(rng: np.random.Generator, width: int) -> np.ndarray:
    """(H, width, 3) gray values of a textured surface, 40 to 130."""
    noise = cv2.GaussianBlur(rng.normal(size=(SIZE[0], width)).astype(np.float32), (0, 0), 1.5)
    gray = 85 + 20 * noise / noise.std()
    return np.repeat(np.clip(gray, 40, 130)[..., None], 3, axis=2)


def frame(left: np.ndarray, right: np.ndarray, depth: type = np.uint8) -> StereoFrame:
    scale = np.iinfo(depth).max / 255
    return StereoFrame("a", *(np.round(side * scale).astype(depth) for side in (left, right)))


def ranges(known: float = 1.0) -> RangeMap:
    """A plane at one range, known from the first column on to this fraction of the width."""
    disparity = np.full(SIZE, SHIFT, np.float32)
    disparity[:, round(known * SIZE[1]) :] = np.nan
    measured = np.isfinite(disparity)
    ones = np.where(measured, np.float32(1), np.float32(np.nan))
    return RangeMap(
        disparity, ones, ones, 0.01 * ones, np.nan_to_num(ones), np.zeros(SIZE, np.bool_)
    )


def spots(rng: np.random.Generator, number: int = 40) -> np.ndarray:
    """(H, W) share of light of soft bright spots of 1 to 3 pixels."""
    added = np.zeros(SIZE, np.float32)
    for x, y in rng.integers((20, 10), (SIZE[1] - 10, SIZE[0] - 10), (number, 2)):
        cv2.circle(added, (int(x), int(y)), int(rng.integers(1, 4)), rng.uniform(0.3, 1.0), -1)
    return cv2.GaussianBlur(added, (0, 0), 0.7)


@pytest.mark.parametrize("depth", [np.uint8, np.uint16])
@pytest.mark.parametrize("right_light", [1.0, 0.6])
def test_bright_spots_of_the_left_image_alone_are_not_measured(depth, right_light) -> None:
    rng = np.random.default_rng(1)
    whole = surface(rng, SIZE[1] + SHIFT)
    left, right = whole[:, : SIZE[1]], right_light * whole[:, SHIFT:]
    added = spots(rng)
    pair = frame(left + 120 * added[..., None], right, depth)
    found, whole_map = (without_particles(pair, ranges(), fill) for fill in (False, True))
    clear, rest, gone = added > 0.3, added < 0.01, found.confidence == 0
    assert clear.sum() > 200
    assert gone[clear].mean() > 0.9
    assert gone[rest].mean() < 0.001
    for values in (found.disparity, found.depth_m, found.range_m, found.range_std_m):
        np.testing.assert_array_equal(np.isnan(values), gone)
    assert not found.filled.any()
    np.testing.assert_array_equal(whole_map.filled, gone)
    np.testing.assert_array_equal(whole_map.range_m, ranges().range_m)
    np.testing.assert_array_equal(np.isnan(whole_map.range_std_m), gone)


def test_a_pair_without_particles_is_returned_as_it_is() -> None:
    rng = np.random.default_rng(2)
    whole = surface(rng, SIZE[1] + SHIFT)
    vignette = np.linspace(0.5, 1.0, SIZE[1])[None, :, None]
    noise = rng.normal(0, 2, (2, *SIZE, 3))
    pair = frame(whole[:, : SIZE[1]] * vignette + noise[0] + 10, whole[:, SHIFT:] + noise[1] + 10)
    plane = ranges()
    assert without_particles(pair, plane, fill=False) is plane


def test_spots_that_both_cameras_see_on_the_surface_are_measured() -> None:
    rng = np.random.default_rng(3)
    whole = surface(rng, SIZE[1] + SHIFT)
    whole[:, : SIZE[1]] += 100 * spots(rng)[..., None]
    plane = ranges()
    pair = frame(whole[:, : SIZE[1]], whole[:, SHIFT:])
    assert without_particles(pair, plane, fill=False) is plane


def test_particles_where_no_range_is_known_stay_unknown() -> None:
    rng = np.random.default_rng(4)
    whole = surface(rng, SIZE[1] + SHIFT)
    added = spots(rng)
    pair = frame(whole[:, : SIZE[1]] + 120 * added[..., None], whole[:, SHIFT:])
    found = without_particles(pair, ranges(0.5), fill=True)
    unknown = np.isnan(ranges(0.5).disparity)
    assert found.filled.any() and not found.filled[unknown].any()


def test_marine_snow_does_not_change_the_water() -> None:
    """One percent of bright pixels made red of the white a quarter too bright, in this frame."""
    paths = (sorted((REEF / side).iterdir())[0] for side in ("left", "right"))
    sides = [read_image(path, InputConfig()) for path in paths]
    rng, snowy = np.random.default_rng(5), []
    for image in sides:
        height, width = image.shape[:2]
        added = np.zeros((height, width), np.float32)
        for x, y in rng.integers(0, (width, height), (200, 2)):
            cv2.circle(added, (int(x), int(y)), 2, rng.uniform(0.1, 0.6), -1)
        light = decode_srgb(image / 255.0) + cv2.GaussianBlur(added, (0, 0), 1)[..., None]
        snowy.append(np.round(255 * encode_srgb(np.clip(light, 0, 1))).astype(np.uint8))
    pipeline = Pipeline(load_rig(REEF / "cam.yaml"), RunConfig())
    whites = [
        pipeline.process(StereoFrame("a", *pair)).correction.water.white for pair in (sides, snowy)
    ]
    clear, with_snow = (white / white[1] for white in whites)
    np.testing.assert_allclose(with_snow, clear, rtol=0.03)
