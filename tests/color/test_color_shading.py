"""Shadows and sunlight that move over the reef: the shading of each frame comes back, and none is
found where there is none.
"""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from calibration import Rectification
from calibration.formats import load_rig
from stereo_seecolor.color.photometry.light_model import SHADING, places, shading_map, shading_terms
from stereo_seecolor.color.photometry.light_of_frames import (
    ACROSS,
    MEAN,
    PART,
    Differences,
    solve_frames,
)
from stereo_seecolor.color.photometry.light_solver import LightTerms
from stereo_seecolor.color.photometry.observations import Observations
from stereo_seecolor.color.photometry.survey_light import SurveyLight, solve_light
from stereo_seecolor.compute.threads import Threads
from stereo_seecolor.dive import light_search
from stereo_seecolor.dive.light_search import LightSearch, SampleSettings
from stereo_seecolor.files.srgb import decode_srgb, encode_srgb
from stereo_seecolor.inputs.images import read_image, read_range_map
from stereo_seecolor.records import Capture, Image, Map

Array = NDArray[np.float64]
REEF = Path(__file__).parents[2] / "data_samples" / "reef"
RECTIFICATION = Rectification.from_rig(load_rig(REEF / "cam.yaml"))
HALF = RECTIFICATION.pair.reduced(2)
ALL = LightTerms(pattern=True, ranged=True, gains=True, shading=True)
SIZE = (160, 128)
FRAMES = 12


def waves(place: Array, frame: NDArray[np.int64] | int) -> Array:
    """(N,) logarithm of light at (N, 2) places of -1 to 1: a wave of two pictures, elsewhere in
    each frame.
    """
    return np.asarray(0.25 * np.sin(np.pi * (place @ [0.35, 0.3]) + 2.3 * np.asarray(frame) + 0.5))


def windows(seen_as: float, color: tuple[float, float, float], noise: float) -> list[Observations]:
    """Spots that move down the picture under waves, ``seen_as`` times as strong and of that color:
    one window a frame, of four.
    """
    rng, found = np.random.default_rng(1), []
    for first in range(FRAMES - 3):
        patch, view = np.repeat(np.arange(300), 4), np.tile(np.arange(4), 300)
        start = rng.uniform(0, [SIZE[0] - 1, SIZE[1] - 80], (300, 2))
        pixel = start[patch] + np.stack([rng.uniform(-20, 20, patch.size), 25.0 * view], axis=1)
        light = seen_as * waves(places(pixel, SIZE), first + view)[
            :, None
        ] * color + noise * rng.standard_normal((patch.size, 3))
        light += np.log(rng.uniform(0.05, 0.3, (300, 3)))[patch]
        range_m = rng.uniform(1.5, 2.5, patch.size)
        found.append(
            Observations(patch, view, range_m, np.exp(light), pixel, np.arange(first, first + 4))
        )
    return found


def solved(seen: list[Observations], allowed: LightTerms = ALL) -> SurveyLight:
    found = solve_light(seen, [str(k) for k in range(FRAMES)], SIZE, allowed)
    assert found is not None
    return found


def left_of_waves(maps: list[NDArray[np.float32]], size: tuple[int, int]) -> float:
    """rms over frames and pictures of what is left, less what all frames have in common, as a
    fraction of what was there.
    """
    y, x = np.mgrid[: size[1], : size[0]]
    place = places(np.stack([x.ravel(), y.ravel()], axis=1).astype(float), size)
    true = np.array([waves(place, k) for k in range(len(maps))])
    true -= true.mean(axis=1, keepdims=True)
    left = true - np.array([one.mean(axis=2).ravel() for one in maps])
    return float(np.std(left - left.mean(axis=0)) / np.std(true - true.mean(axis=0)))


@pytest.mark.slow
def test_waves_that_move_over_the_reef_are_found_and_no_pattern_is_made_of_them() -> None:
    found = solved(windows(1.0, (1, 1, 1), 0.02))
    assert found.light is not None
    assert (found.luminance.use.shading, any(found.color.use)) == (True, False)
    assert (
        left_of_waves([found.light.on(str(k), SIZE).log_shading for k in range(FRAMES)], SIZE) < 0.3
    )
    assert found.luminance.after.between_views < 0.2 * found.luminance.before.between_views
    assert "shadows and sunlight that move" in found.note
    without = solved(windows(1.0, (1, 1, 1), 0.02), ALL._replace(shading=False))
    assert without.luminance.after.between_views > 4 * found.luminance.after.between_views


@pytest.mark.slow
def test_waves_of_another_color_than_the_light_are_found_in_color() -> None:
    found = solved(windows(0.3, (1.5, 1.0, 0.5), 0.01))
    assert found.color.use.shading
    assert found.color.after.between_views < 0.5 * found.color.before.between_views


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.01, 0.4])
def test_even_light_has_no_shading(noise: float) -> None:
    assert solved(windows(0.0, (1, 1, 1), noise)).light is None


def test_the_map_of_a_shading_is_its_terms() -> None:
    coefficients = np.random.default_rng(2).standard_normal((SHADING, 3))
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    terms = shading_terms(places(np.stack([x.ravel(), y.ravel()], axis=1).astype(float), SIZE))
    found = shading_map(coefficients.ravel(), SIZE)
    np.testing.assert_allclose(found, (terms @ coefficients).reshape(found.shape), atol=1e-5)
    assert np.abs(found.mean(axis=(0, 1))).max() < 1e-3  # brightness as a whole is the gain's


@pytest.mark.slow
@pytest.mark.parametrize("frames", [40, 300])
def test_gain_and_shading_of_a_chain_of_frames_come_back(frames: int) -> None:
    """By the dense solver and by the one for long dives; some parts are seen wrongly."""
    rng = np.random.default_rng(3)
    true = rng.normal(0, [0.2, 0.2, 0.1, 0.1, 0.1], (frames, SHADING))
    gains, found = rng.normal(0, 0.2, frames), []
    for i in range(frames):
        for j in (i - 1, i - 2, i - 4):
            for part in range(18) if j >= 0 else ():
                at_i = rng.uniform([-1, -1 + 0.3 * (i - j)], 1)
                at = np.rint(ACROSS * np.stack([at_i, at_i - [0, 0.3 * (i - j)]]))
                terms = shading_terms(at / ACROSS)
                value = terms[0] @ true[i] - terms[1] @ true[j] + gains[i] - gains[j]
                value += rng.normal(0, 0.01) + (rng.random() < 0.02)
                found.append((i, j, *at, (value, 0, 0, 0), 20, part % 2))
    parts = Differences(np.array(found, PART), np.zeros(0, MEAN))
    solved = solve_frames(parts, np.zeros(frames), (True, False), chosen=(True, False))
    assert np.ptp(solved.shading, axis=2).max() < 1e-12
    # what stays in place on the reef no view tells from it
    assert np.std(solved.shading[..., 0] - true) < 0.4 * np.std(true)
    step = np.diff(solved.gains[:, 0] - gains)
    assert np.median(np.abs(step)) < 0.05
    assert not solve_frames(parts, np.zeros(frames), (False, False)).shading.any()


@pytest.mark.slow
@pytest.mark.parametrize("most_frames", [60, 10], ids=["short dive", "long dive"])
def test_waves_over_the_sample_dive(most_frames: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """A long dive's shading is chained from parts of pictures, once segments of it have shown that
    there is some.
    """
    monkeypatch.setattr(light_search, "SAMPLE", SampleSettings(most_frames=most_frames))
    names = sorted(path.stem for path in (REEF / "left").iterdir())

    def read(name: str) -> tuple[Image, Map]:
        light = decode_srgb(
            RECTIFICATION.apply_left(read_image(REEF / "left" / f"{name}.png")) / 255.0
        )[::2, ::2]
        y, x = np.mgrid[: light.shape[0], : light.shape[1]]
        place = places(np.stack([x.ravel(), y.ravel()], axis=1).astype(float), light.shape[1::-1])
        light *= np.exp(waves(place, names.index(name)) - 0.3).reshape(*light.shape[:2], 1)
        range_m = read_range_map(REEF / "truth" / "range" / f"{name}.tiff")[::2, ::2]
        return np.round(255 * encode_srgb(light)).astype(np.uint8), np.ascontiguousarray(range_m)

    frames = [(name, name) for name in names]
    found = (
        LightSearch(frames, read, [Capture()] * len(frames), HALF, "srgb", Threads(2))
        .solve(ALL)
        .light
    )
    assert found is not None
    assert found.light is not None
    assert found.luminance.use.shading
    assert (
        left_of_waves([found.light.on(name, (96, 80)).log_shading for name in names], (96, 80))
        < 0.5
    )
