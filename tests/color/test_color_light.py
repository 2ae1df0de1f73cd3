"""The light of a survey from spots that several frames see: known patterns and gains come back;
even light is left alone.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from color_waters import clear_water
from numpy.typing import NDArray

from stereo_seecolor.color.corrector import Corrector
from stereo_seecolor.color.photometry import color_after_water
from stereo_seecolor.color.photometry.color_after_water import refit_color_after_water
from stereo_seecolor.color.photometry.color_trend import ColorTrend, with_color_trend
from stereo_seecolor.color.photometry.crossing import alike, pictures_crossed
from stereo_seecolor.color.photometry.divided_light import divide_illumination, with_clipped
from stereo_seecolor.color.photometry.light_model import (
    SHADING,
    TERMS,
    Light,
    lit_by,
    places,
    shading_terms,
)
from stereo_seecolor.color.photometry.light_solver import LightTerms
from stereo_seecolor.color.photometry.observations import Observations
from stereo_seecolor.color.photometry.survey_light import SurveyLight, solve_light
from stereo_seecolor.config import ColorConfig
from stereo_seecolor.files.srgb import encode_srgb
from stereo_seecolor.records import Water

SIZE = (160, 128)
FRAMES = 12
ALL = LightTerms(pattern=True, ranged=True, gains=True, shading=True)


def vignette(pixel: NDArray[np.float64]) -> NDArray[np.float64]:
    """Logarithm: light lost towards the corners, more so on the right."""
    x, y = ((2 * pixel[:, axis] + 1 - SIZE[axis]) / SIZE[axis] for axis in (0, 1))
    return -0.3 * (x**2 + y**2) - 0.15 * x


PATCHES = 300
"""Of a window, each seen by four frames."""


def spots_moving_down(
    rng: np.random.Generator,
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Which patch and which of four frames each observation is of, and its pixel, 25 farther down
    from
    frame to frame.
    """
    patch, view = np.repeat(np.arange(PATCHES), 4), np.tile(np.arange(4), PATCHES)
    start = rng.uniform(0, [SIZE[0] - 1, SIZE[1] - 80], (PATCHES, 2))
    return (
        patch,
        view,
        start[patch] + np.stack([rng.uniform(-20, 20, patch.size), 25.0 * view], axis=1),
    )


def windows(
    pattern: bool, gains: NDArray[np.float64], noise: float, fade: float = 0.0
) -> list[Observations]:
    """Spots of random color that move down the picture from frame to frame, one window a frame,
    four frames each.
    """
    rng = np.random.default_rng(1)
    found = []
    for first in range(FRAMES - 3):
        patch, view, pixel = spots_moving_down(rng)
        range_m = rng.uniform(1.5, 2.5, patch.size)
        log_light = np.log(rng.uniform(0.05, 0.3, (PATCHES, 3)))[patch] + gains[first + view]
        log_light += (vignette(pixel) * pattern - fade * np.log(range_m / 2))[
            :, None
        ] + noise * rng.standard_normal((patch.size, 1))
        log_light[rng.random(patch.size) < 0.05] += 1.0  # fish, and flashes of the sun
        frames = np.arange(first, first + 4)
        found.append(Observations(patch, view, range_m, np.exp(log_light), pixel, frames))
    return found


def solved(
    *arguments: float | bool | NDArray[np.float64], allowed: LightTerms = ALL, **keywords: float
) -> SurveyLight:
    names = [f"{i:02d}" for i in range(FRAMES)]
    found = solve_light(windows(*arguments, **keywords), names, SIZE, allowed)  # type: ignore[arg-type]
    assert found is not None
    return found


def some_gains() -> NDArray[np.float64]:
    gains = 0.25 * np.random.default_rng(2).standard_normal((FRAMES, 1)) * np.ones(3)
    return np.asarray(gains - gains.mean())


def pattern_error(light: Light) -> float:
    """rms of what is left of the vignette, once its mean is taken out."""
    y, x = np.mgrid[: SIZE[1] : 4, : SIZE[0] : 4]
    pixel = np.stack([x.ravel(), y.ravel()], axis=1).astype(float)
    left = light.log_pattern(pixel, np.full(len(pixel), light.reference_m), SIZE)[:, 1] - vignette(
        pixel
    )
    return float(left.std())


@pytest.mark.slow
def test_pattern_and_gains_come_back() -> None:
    gains = some_gains()
    found = solved(True, gains, 0.1)
    assert found.light is not None
    assert (found.luminance.use.pattern, found.luminance.use.gains, any(found.color.use)) == (
        True,
        True,
        False,
    )
    assert pattern_error(found.light) < 0.05
    measured = np.stack([found.light.gains[f"{i:02d}"] for i in range(FRAMES)])
    # a slope of the pattern along the track and a drift of gains look alike
    assert np.abs(measured - gains).max() < 0.1
    assert np.abs(measured.mean()) < 1e-9
    assert found.luminance.after.between_views < 0.6 * found.luminance.before.between_views
    assert found.luminance.after.between_frames < 0.3 * found.luminance.before.between_frames
    assert "uneven light over the image" in found.note
    assert found.content()["luminance"]["used"][0] == "pattern"


@pytest.mark.slow
def test_frames_that_differ_in_color_get_a_gain_for_each_channel() -> None:
    gains = 0.1 * np.random.default_rng(3).standard_normal((FRAMES, 3))
    gains -= gains.mean(axis=0)
    found = solved(False, gains, 0.02)
    assert found.light is not None
    assert found.color.use == LightTerms(gains=True)
    measured = np.stack([found.light.gains[f"{i:02d}"] for i in range(FRAMES)])
    assert np.abs(measured - gains).max() < 0.03


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.01, 0.4])
def test_even_light_is_left_alone(noise: float) -> None:
    found = solved(False, np.zeros((FRAMES, 3)), noise)
    assert found.light is None
    assert found.note == ""


def test_terms_that_are_switched_off_are_not_used() -> None:
    found = solved(True, some_gains(), 0.1, allowed=LightTerms(pattern=True))
    assert found.light is not None
    assert (found.luminance.use.pattern, found.luminance.use.gains, found.light.gains) == (
        True,
        False,
        {},
    )


@pytest.mark.slow
def test_the_fall_off_of_lamps_is_what_water_does_not_explain() -> None:
    found = solved(True, np.zeros((FRAMES, 3)), 0.05, fade=2.0)
    assert found.light is not None
    assert found.light.fade == pytest.approx(2.0, abs=0.2)
    clear, every = Water(*np.zeros((8, 3))), np.ones(3)
    assert lit_by(clear, found.light).fall_off == pytest.approx(found.light.fade)
    gray = Water(*np.zeros((6, 3)), y=0.5 * every, x=0 * every)
    explained = 0.5 * found.light.reference_m
    assert lit_by(gray, found.light).fall_off == pytest.approx(
        found.light.fade - explained, abs=0.02
    )
    assert lit_by(gray, None) is gray


def lamplight(pixel: NDArray[np.float64], range_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Logarithm: two lamps beside a camera 70 degrees wide, of a beam that is half as bright at 37
    degrees.
    """
    ray = np.column_stack([(2 * pixel + 1 - np.array(SIZE)) / SIZE[0] * 0.7, np.ones(len(pixel))])
    point_m = ray / np.linalg.norm(ray, axis=1, keepdims=True) * range_m[:, None]
    away = [point_m - np.array([x_m, -0.12, -0.1]) for x_m in (-0.3, 0.42)]
    distance_m = [np.linalg.norm(part, axis=1) for part in away]
    return np.log(
        sum((part[:, 2] / d) ** 3 / d**2 for part, d in zip(away, distance_m, strict=True))
    )


def night_windows(gains: NDArray[np.float64]) -> list[Observations]:
    """A camera that climbs from 1.6 to 2.6 m over spots of a rough bottom, which each four frames
    see.
    """
    rng, found = np.random.default_rng(6), []
    for first in range(FRAMES - 3):
        patch, view, pixel = spots_moving_down(rng)
        range_m = (1.6 + (first + view) / (FRAMES - 1)) * np.exp(rng.normal(0, 0.05, PATCHES))[
            patch
        ]
        log_light = np.log(rng.uniform(0.05, 0.2, (PATCHES, 3)))[patch] + gains[first + view]
        log_light += (lamplight(pixel, range_m) + rng.normal(0, 0.02, patch.size))[:, None]
        found.append(
            Observations(
                patch, view, range_m, np.exp(log_light), pixel, np.arange(first, first + 4)
            )
        )
    return found


@pytest.mark.slow
def test_the_fall_off_of_lamps_is_told_from_frames_that_were_lit_less() -> None:
    gains = np.repeat(0.15 * np.random.default_rng(7).standard_normal((FRAMES, 1)), 3, axis=1)
    found = solve_light(
        night_windows(gains - gains.mean()), [f"{i:02d}" for i in range(FRAMES)], SIZE, ALL
    )
    assert found is not None
    assert found.light is not None
    assert found.light.fade == pytest.approx(2.0, abs=0.5)


def lines_apart(lit: bool) -> list[Observations]:
    """Two lines at two heights of which no spot is seen from both; the first in even light, or
    ``lit`` as the second by lamps.
    """
    near_m, windows = (
        1.0,
        [
            seen
            for seen in night_windows(np.zeros((FRAMES, 3)))
            if seen.frames[0] < 3 or seen.frames[0] > 5
        ],
    )
    for seen in (window for window in windows if window.frames[0] < 3 and not lit):
        lamps = lamplight(seen.pixel, seen.range_m) - lamplight(
            np.array([SIZE]) / 2.0, np.array([near_m])
        )
        seen.light[:] = np.exp(np.log(seen.light) - lamps[:, None])
    return windows


@pytest.mark.slow
def test_lamps_switched_on_between_lines_that_share_no_spot_are_not_taken_out_of_the_first() -> (
    None
):
    names = [f"{i:02d}" for i in range(FRAMES)]
    found = solve_light(lines_apart(lit=False), names, SIZE, ALL)
    assert found is not None
    assert found.light is not None
    assert found.light.fade == 0
    assert "were lit differently" in found.note
    assert found.content()["parts_lit_differently"] is True
    throughout = solve_light(lines_apart(lit=True), names, SIZE, ALL)
    assert throughout is not None
    assert throughout.light is not None
    assert throughout.light.fade > 1
    assert "parts_lit_differently" not in throughout.content()


def test_frames_that_differ_no_more_than_caustics_explain_get_no_gains() -> None:
    """Neighboring spots lie under one caustic, those that judge and those of the fit alike."""
    rng, even = np.random.default_rng(8), windows(False, np.zeros((FRAMES, 3)), 0.05)
    for seen in even:
        caustics = (
            0.25
            * rng.standard_normal((1 + seen.patch.max() // 10, FRAMES))[
                seen.patch // 10, seen.frame
            ]
        )
        seen.light[:] = np.exp(np.log(seen.light) + caustics[:, None])
    found = solve_light(even, [f"{i:02d}" for i in range(FRAMES)], SIZE, LightTerms(gains=True))
    assert found is not None
    assert found.luminance.before.between_frames > 0.03
    assert not found.luminance.use.gains


def two_lines(
    gains: NDArray[np.float64], pattern: Callable[[NDArray[np.float64]], NDArray[np.float64]]
) -> list[Observations]:
    """Spots under two lines that a camera flies to and fro without turning, so that these overlap
    by a third of a picture.
    """
    rng = np.random.default_rng(5)
    place = [
        (0, 25 * k) if k < FRAMES // 2 else (110, 25 * (FRAMES - 1 - k)) for k in range(FRAMES)
    ]
    spots = rng.uniform([0, 0], [270, 250], (3000, 2))
    pixel = spots[:, None] - np.array(place)
    patch, view = np.nonzero(((pixel > 0) & (pixel < np.array(SIZE) - 1)).all(axis=2))
    pixel, range_m = pixel[patch, view], rng.uniform(1.5, 2.5, len(patch))
    log_light = np.log(rng.uniform(0.05, 0.3, (len(spots), 1)) * np.ones(3))[patch]
    log_light += (gains[view] + pattern(pixel) + rng.normal(0, 0.05, len(patch)))[:, None]
    return [Observations(patch, view, range_m, np.exp(log_light), pixel, np.arange(FRAMES))]


def radial(pixel: NDArray[np.float64]) -> NDArray[np.float64]:
    x, y = ((2 * pixel[:, axis] + 1 - SIZE[axis]) / SIZE[0] for axis in (0, 1))
    return np.asarray(-0.3 * (x**2 + y**2))


@pytest.mark.slow
def test_a_sun_that_sinks_is_not_taken_for_a_slope_across_the_track() -> None:
    gains = np.linspace(0.7, -0.7, FRAMES)
    names = [f"{i:02d}" for i in range(FRAMES)]
    found = solve_light(two_lines(gains, radial), names, SIZE, ALL)
    assert found is not None
    assert found.light is not None
    y, x = np.mgrid[: SIZE[1] : 4, : SIZE[0] : 4]
    pixel = np.stack([x.ravel(), y.ravel()], axis=1).astype(float)
    left = found.light.log_pattern(pixel, np.full(len(pixel), found.light.reference_m), SIZE)[
        :, 1
    ] - radial(pixel)
    assert left.std() < 0.05
    measured = np.array([found.light.gains[name][1] for name in names])
    assert np.abs(measured - gains).max() < 0.1


@pytest.mark.slow
def test_how_well_the_pattern_is_known_is_said() -> None:
    def error(frames: int) -> float:
        seen = night_windows(np.zeros((FRAMES, 3)))[:frames]
        found = solve_light(seen, [f"{i:02d}" for i in range(FRAMES)], SIZE, ALL)
        assert found is not None
        return found.luminance.error

    assert 0 < error(9) < 0.8 * error(2)
    found = solved(True, some_gains(), 0.1)
    assert 0.3 * found.luminance.error < pattern_error(found.solved) < 2 * found.luminance.error
    assert found.content()["pattern_error"] == found.luminance.error
    assert f"standard error of the uneven light {100 * found.luminance.error:.0f} %;" in found.note
    loose = replace(found, luminance=replace(found.luminance, error=0.2))
    assert "standard error of the uneven light 20 %: lines that overlap" in loose.note


def some_light() -> Light:
    coefficients = 0.05 * np.random.default_rng(4).standard_normal((TERMS, 3))
    trend = ColorTrend(np.array([-0.5, 0.2, 0.3]), 0.1, 2.0, np.array([0.1, 0.2, 0.2]))
    shading = {"a": 0.03 * np.random.default_rng(6).standard_normal(3 * SHADING)}
    return Light(
        coefficients, 2.0, (1.2, 3.0), {"a": np.array([0.1, 0.0, -0.2])}, 1.5, trend, shading
    )


def test_light_survives_json() -> None:
    light = some_light()
    again = Light.from_content(light.content())
    assert again.content() == light.content()
    assert (
        again.fingerprint
        == light.fingerprint
        != Light.from_content({**light.content(), "fade": 1.0}).fingerprint
    )
    assert light.fingerprint != replace(light, shading={}).fingerprint


@pytest.mark.slow
@pytest.mark.parametrize(
    ("dtype", "encoding"), [(np.uint8, "srgb"), (np.uint16, "linear"), (np.uint16, "srgb")]
)
def test_taking_light_out_is_the_inverse_of_its_model(dtype: type, encoding: str) -> None:
    from stereo_seecolor.color.table.encoding import decoded_values

    light, full = some_light(), np.iinfo(dtype).max
    rng = np.random.default_rng(5)
    image = rng.integers(full // 10, full // 2, (*SIZE[::-1], 3)).astype(dtype)
    range_m = rng.uniform(1.0, 3.5, SIZE[::-1]).astype(np.float32)
    range_m[:4] = np.nan
    out = divide_illumination(image, range_m, light.on("a", SIZE), encoding)  # type: ignore[arg-type]
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    pixel = np.stack([x.ravel(), y.ravel()], axis=1).astype(float)
    known_m = np.nan_to_num(range_m.ravel(), nan=light.reference_m).astype(float)
    shading = shading_terms(places(pixel, SIZE)) @ light.shading["a"].reshape(SHADING, 3)
    factor = np.exp(light.log_pattern(pixel, known_m, SIZE) + light.gains["a"] + shading).reshape(
        image.shape
    )
    decoded = decoded_values(8 * image.dtype.itemsize, encoding)  # type: ignore[arg-type]
    expected = decoded[image] / factor
    inside = expected < 0.9
    tolerance = 0.05 if dtype == np.uint8 else 0.001  # half a value of 255 is 4 % in the dark
    assert np.abs(decoded[out] / expected - 1)[inside].max() < tolerance


def test_statistics_still_see_what_the_camera_clipped() -> None:
    image = np.full((*SIZE[::-1], 3), (200, 255, 230), np.uint8)
    image[:, ::2] = 120
    brighter = replace(some_light(), gains={"a": np.full(3, 2.5)})
    divided = divide_illumination(
        image, np.full(SIZE[::-1], 2.0, np.float32), brighter.on("a", SIZE), "srgb"
    )
    assert divided.max() < 200
    out = with_clipped(divided, image)
    assert (out[:, 1::2] == image[:, 1::2]).all()
    assert (out[:, ::2] == divided[:, ::2]).all()


@pytest.mark.parametrize("depth", [8, 16])
def test_clipped_sand_is_as_bright_as_the_sand_beside_it(depth: int) -> None:
    """In a frame that is brighter than the others by 2.5: the camera clipped green and blue of the
    right half.
    """
    full = 2**depth - 1
    lit = np.linspace(0.6, 1.5, SIZE[0])[:, None] * np.array([0.6, 1.0, 1.0])
    image = np.tile(np.round(encode_srgb(np.minimum(lit, 1)) * full), (SIZE[1], 1, 1))
    image = image.astype(np.uint8 if depth == 8 else np.uint16)
    range_m = np.full(SIZE[::-1], 2.0, np.float32)
    brighter = Light(np.zeros((TERMS, 3)), 2.0, (1.2, 3.0), {"a": np.full(3, np.log(2.5))})
    divided = divide_illumination(image, range_m, brighter.on("a", SIZE), "srgb")
    water = replace(clear_water("srgb"), white=np.array([0.6, 1.0, 1.0]))
    shown = Corrector(ColorConfig()).apply(divided, range_m, water, exposure=1.0, camera=image)
    row = shown.image[5].astype(float) / full
    assert shown.unrecoverable[5].mean() > 0.4
    assert np.abs(np.diff(row, axis=0)).max() < 0.02, "no edge where the camera clipped"
    assert np.ptp(row, axis=1).max() < 0.02, "white from end to end"


def crossing(pictures: float, patches: int = 800) -> list[Observations]:
    """Three frames of one spot, over which the reef moves by so many pictures in all; the picture's
    left side is lit red.
    """
    rng, found = np.random.default_rng(8), []
    step = np.array([0.0, 0.5 * pictures * SIZE[1]])
    for later in (1, 2):
        start = rng.uniform(0, SIZE - np.array([1, 1]) - step, (patches, 2))
        patch, view = np.repeat(np.arange(patches), 2), np.tile([1, 0], patches)
        pixel = (
            start[patch]
            + view[:, None] * step
            + np.stack([30.0 * view * rng.uniform(-1, 1, view.size), 0.0 * view], axis=1)
        )
        x = (2 * pixel[:, :1] + 1 - SIZE[0]) / SIZE[0]
        log_light = rng.uniform(-2.5, -1.5, (patches, 3))[patch] + x * np.array([-0.4, -0.1, -0.1])
        light = np.exp(log_light + 0.01 * rng.standard_normal((view.size, 1)))
        found.append(
            Observations(
                patch, 1 - view, np.full(view.size, 2.0), light, pixel, np.array([later, later - 1])
            )
        )
    return found


def redder_ahead(frames: int) -> list[Observations]:
    """Spots that move down the pictures, which are redder at the top; frames do not differ."""
    rng, found = np.random.default_rng(1), []
    for first in range(frames - 3):
        patch, view, pixel = spots_moving_down(rng)
        y = (2 * pixel[:, 1:] + 1 - SIZE[1]) / SIZE[1]
        log_light = np.log(rng.uniform(0.05, 0.3, (PATCHES, 3)))[patch]
        log_light += y * np.array([-0.2, 0.1, 0.1]) + 0.05 * rng.standard_normal((patch.size, 3))
        range_m = rng.uniform(1.5, 2.5, patch.size)
        frames = np.arange(first, first + 4)
        found.append(Observations(patch, view, range_m, np.exp(log_light), pixel, frames))
    return found


@pytest.mark.slow
@pytest.mark.parametrize(("frames", "corrected"), [(6, False), (12, True)])
def test_a_slope_of_color_along_the_track_is_not_taken_for_a_drift_of_frames(
    frames: int, corrected: bool
) -> None:
    names = [str(frame) for frame in range(frames)]
    found = solve_light(redder_ahead(frames), names, SIZE, ALL)
    assert found is not None
    assert found.solved.gains == {}
    assert found.color.use.pattern == corrected
    before, after = found.color.before.between_frames, found.color.after.between_frames
    assert (after < 0.1 * before) == corrected


def test_a_dive_is_as_long_as_the_reef_that_its_frames_show() -> None:
    assert pictures_crossed(crossing(0.3), SIZE) == pytest.approx(0.3, abs=0.02)
    assert pictures_crossed([], SIZE) == 0
    assert alike(3.0, 1).views == alike(1.5, 1).views == 10
    assert alike(0.5, 1).views == pytest.approx(30)
    assert np.isfinite(alike(0.0, 1).views)
    assert alike(1.0, 8).windows == 4  # two pictures of reef in eight windows


@pytest.mark.slow
@pytest.mark.parametrize(
    ("pictures", "patches", "used"),
    [(0.3, 800, (True, False)), (1.2, 800, (True, True)), (0.3, 100, (False, False))],
)
def test_a_few_frames_give_a_pattern_of_brightness_and_more_reef_one_of_color(
    pictures: float, patches: int, used: tuple[bool, bool]
) -> None:
    found = solve_light(crossing(pictures, patches), ["a", "b", "c"], SIZE, ALL)
    assert found is not None
    assert (found.luminance.use.pattern, found.color.use.pattern) == used
    assert ("color not corrected for it: the reef moved by 0.3 image sizes" in found.note) == (
        used == (True, False)
    )
    assert ("only 100 spots are seen by two frames" in found.note) == (not any(used))


def bowl() -> list[Observations]:
    """A bottom that is farther at the picture's borders, in a light that is redder there and bluer
    on one side.
    """
    rng, found = np.random.default_rng(8), []
    for first in range(FRAMES - 3):
        patch, view, pixel = spots_moving_down(rng)
        radius = radius2(pixel)
        range_m = 2 * (1 + 0.15 * radius) * rng.uniform(0.9, 1.1, PATCHES)[patch]
        log_light = np.log(rng.uniform(0.02, 0.3, (PATCHES, 1)) * [0.4, 1.0, 0.9])[patch]
        log_light += np.stack([0.3 * radius, 0 * radius, 0.002 * pixel[:, 0]], axis=1) + rng.normal(
            0, 0.01, (patch.size, 3)
        )
        found.append(
            Observations(
                patch, view, range_m, np.exp(log_light), pixel, np.arange(first, first + 4)
            )
        )
    return found


def radius2(pixel: NDArray[np.float64]) -> NDArray[np.float64]:
    x, y = ((2 * pixel[:, axis] + 1 - SIZE[axis]) / SIZE[axis] for axis in (0, 1))
    return np.asarray(x**2 + y**2)


def redder_at_borders(light: Light, seen: list[Observations]) -> float:
    """Red over green (logarithm) for each unit of squared radius, once the light is taken out of
    all spots and then the water.
    """
    pixel, range_m, shown = (
        np.concatenate([getattr(one, part) for one in seen])
        for part in ("pixel", "range_m", "light")
    )
    even = shown * np.exp(-light.log_pattern(pixel, range_m, SIZE))
    image = np.round(65535 * even).astype(np.uint16)[None]
    fitted = Corrector(ColorConfig(input_encoding="linear")).fit_frame(
        image, range_m[None].astype(np.float32)
    )
    water = with_color_trend(fitted, light.color_trend)
    direct = np.maximum((even - water.backscatter(range_m)) / water.attenuation(range_m), 1e-4)
    return float(np.polyfit(radius2(pixel), np.log(direct[:, 0] / direct[:, 1]), 1)[0])


@pytest.mark.slow
def test_borders_have_the_color_of_the_middle_once_the_water_is_taken_out_too() -> None:
    seen, names = bowl(), [f"{i:02d}" for i in range(FRAMES)]
    found = solve_light(seen, names, SIZE, ALL)
    assert found is not None
    beside = refit_color_after_water(found, seen, names, SIZE)
    before, after = (abs(redder_at_borders(light.solved, seen)) for light in (found, beside))
    assert after < 0.5 * before, (before, after)


@pytest.mark.slow
def test_frames_that_no_window_shows_cost_nothing_beside_the_water() -> None:
    # a dive so long that a square matrix of its frames has 3 GB
    seen, names = (bowl(), [f"{i:05d}" for i in range(20_000)])
    short, long = (solve_light(seen, some, SIZE, ALL) for some in (names[:FRAMES], names))
    assert short is not None
    assert long is not None
    lights = [
        refit_color_after_water(short, seen, names[:FRAMES], SIZE).solved,
        refit_color_after_water(long, seen, names, SIZE).solved,
    ]
    np.testing.assert_array_equal(lights[0].coefficients, lights[1].coefficients)
    assert (lights[0].coefficients != short.solved.coefficients).any()


@pytest.mark.slow
def test_a_water_that_hides_all_spots_leaves_the_light_as_it_is(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seen, names = bowl(), [f"{i:02d}" for i in range(FRAMES)]
    found = solve_light(seen, names, SIZE, ALL)
    assert found is not None
    milk = Water(np.ones(3), 10 * np.ones(3), *np.zeros((6, 3)))
    monkeypatch.setattr(color_after_water, "_water", lambda _: milk)
    assert refit_color_after_water(found, seen, names, SIZE) is found
