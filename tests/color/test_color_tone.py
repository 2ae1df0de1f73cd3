"""How bright a picture is shown: at one median luminance; highlights roll off at one chromaticity,
and what was clipped or lost to noise comes out neutral and is marked.
"""

from dataclasses import replace

import numpy as np
import pytest
from color_waters import clear_water

from stereo_seecolor.color.corrector import Corrector
from stereo_seecolor.color.render import water_gains
from stereo_seecolor.color.render.water_gains import MID_GRAY
from stereo_seecolor.color.table.encoding import decode
from stereo_seecolor.config import ColorConfig
from stereo_seecolor.files.srgb import LUMINANCE

CONFIG = ColorConfig()
CLEAR, LIMIT = clear_water("srgb"), water_gains.OUTPUT_NOISE


@pytest.fixture(autouse=True)
def gain_without_limit(monkeypatch):
    monkeypatch.setattr(water_gains, "OUTPUT_NOISE", 1e9)


def encoded(light, depth=8):
    light = np.asarray(light, float)
    value = np.where(
        light <= 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 1e-9) ** (1 / 2.4) - 0.055
    )
    return np.round(np.clip(value, 0, 1) * (2**depth - 1)).astype(
        np.uint8 if depth == 8 else np.uint16
    )


def scene(median, brightest=0.9, shape=(80, 120), depth=8):
    """Linear light around a median, warm, with a few pixels as bright as a white card."""
    rng = np.random.default_rng(1)
    light = median * np.exp(0.5 * rng.standard_normal((*shape, 1))) * np.array([1.1, 1.0, 0.8])
    light[:2] = brightest
    return encoded(light, depth), np.full(shape, 2.0, np.float32)


def linear(image):
    return decode(image / np.iinfo(image.dtype).max, "srgb")


@pytest.mark.parametrize("depth", [8, 16])
def test_light_rolls_off_above_mid_gray_and_keeps_its_chromaticity(depth):
    light = np.linspace(0.02, 0.24, 60)[:, None] * np.array([1.0, 0.7, 0.4])
    image = np.repeat(encoded(light, depth)[None], 4, axis=0)
    range_m = np.full(image.shape[:2], 2.0, np.float32)
    plain = linear(image) * 4
    shown = linear(
        Corrector(CONFIG).apply(image, range_m, CLEAR, exposure=4.0, highlights=4.0).image
    )
    step = 0.02 if depth == 8 else 1e-3
    below = plain.max(axis=2) < MID_GRAY
    assert np.abs(shown / plain - 1)[below].max() < step
    assert (shown / plain).max(axis=2)[~below].max() < 1 + step
    assert (np.diff(shown[0, :, 0]) >= 0).all()
    ratios, true = shown[..., 1:] / shown[..., :1], plain[..., 1:] / plain[..., :1]
    assert np.abs(ratios / true - 1).max() < step
    assert shown.max() < 1 < plain[~below].max() + 0.1


def test_both_depths_show_the_same():
    image, range_m = scene(0.01)
    shallow = Corrector(CONFIG).apply(image, range_m, CLEAR)
    deep = Corrector(CONFIG).apply(
        image.astype(np.uint16) * 257,
        range_m,
        CLEAR,
        exposure=shallow.exposure,
        highlights=shallow.highlights,
    )
    assert shallow.highlights == 5.0
    assert np.abs(shallow.image - deep.image / 257).max() < 0.7


def spread_of(image):
    """Median luminance, and that of the brightest twentieth."""
    return np.quantile(linear(image) @ LUMINANCE, [0.5, 0.95])


@pytest.mark.parametrize("wanted", [0.05, 0.1, 0.18])
@pytest.mark.parametrize("median", [0.08, 0.2, 0.4])
def test_scenes_are_shown_at_about_one_median_luminance(median, wanted):
    image, range_m = scene(median)
    found = Corrector(ColorConfig(median_luminance=wanted)).apply(image, range_m, CLEAR)
    bright = 2.5 * np.divide(*spread_of(image))  # by the brightest twentieth, at most 1.2 times
    shown, _ = spread_of(found.image)
    assert shown == pytest.approx(
        wanted * np.clip(bright, 1 / 1.2, 1.2), rel=0.03 if wanted < 0.18 else 0.12
    ), "at mid-gray some pixels are compressed"
    assert found.clipped_fraction <= 0.0005


def test_bright_parts_of_two_scenes_are_shown_alike():
    """As sand in two pictures, of which one holds more dark corals."""
    rng = np.random.default_rng(3)
    shown, range_m = [], np.full((90, 120), 2.0, np.float32)
    for spread in (0.5, 0.62):
        light = 0.1 * np.exp(spread * rng.standard_normal((90, 120, 1))) * np.ones(3)
        config = ColorConfig(median_luminance=0.05)
        shown.append(Corrector(config).apply(encoded(light), range_m, CLEAR).image)
    (median, bright), (other_median, other_bright) = map(spread_of, shown)
    assert abs(np.log(bright / other_bright)) < 0.03
    assert np.log(median / other_median) > 0.1


def test_exposure_goes_at_most_five_times_beyond_where_the_brightest_clips():
    image, range_m = scene(0.002)
    found = Corrector(CONFIG).apply(image, range_m, CLEAR)
    assert found.highlights == 5
    assert np.median(linear(found.image) @ LUMINANCE) < 0.18
    assert found.clipped_fraction <= 0.0005


def test_values_as_they_are_have_no_roll_off():
    image, range_m = scene(0.01)
    config = ColorConfig(input_encoding="as-is")
    assert Corrector(config).apply(image, range_m, clear_water("as-is")).highlights == 1


@pytest.mark.parametrize("depth", [8, 16])
def test_what_the_camera_clipped_comes_out_neutral_and_marked(depth):
    full = 2**depth - 1
    water = replace(CLEAR, white=np.array([0.3, 0.9, 1.0]))  # little red arrives
    image = np.array([[[0.65, 1, 1], [1, 1, 1], [0.3, 0.5, 0.5], [0.65, 0.7, 1]]]) * full
    image = image.astype(np.uint8 if depth == 8 else np.uint16)
    wide = np.repeat(image, 20, axis=1)
    found = Corrector(CONFIG).apply(wide, np.full((1, 80), 2.0, np.float32), water, exposure=0.6)
    shown = linear(found.image)[0, 10::20]
    assert found.unrecoverable[0, 10::20].tolist() == [True, True, False, True]
    assert np.ptp(shown[0]) < 0.02, "green and blue are at least as bright as what red says"
    assert np.ptp(shown[1]) < 0.02
    assert shown[1].max() == pytest.approx(1)
    light = decode(image[0] / full, "srgb") * 0.6 / water.white
    assert np.abs(shown[2] - light[2]).max() < 0.01, "what was not clipped is left alone"
    assert np.abs(shown[3, :2] - light[3, :2]).max() < 0.01
    assert shown[3, 2] == pytest.approx(max(light[3, 2], light[3, :2].mean()), abs=0.01)


@pytest.mark.parametrize("depth", [8, 16])
def test_clipped_texture_is_of_one_hue_and_what_is_not_clipped_stays(depth):
    rng = np.random.default_rng(3)
    light = np.array([1.3, 1.25, 0.95]) * np.exp(0.2 * rng.standard_normal((60, 200, 1)))
    light[:, 150:] *= 0.5
    image, range_m = encoded(light, depth), np.full((60, 200), 2.0, np.float32)
    found = Corrector(CONFIG).apply(image, range_m, CLEAR, exposure=0.6).image

    rock = found[:, :140].astype(float)
    assert (image[:, :140].min(axis=2) == image.max()).mean() > 0.2, "many pixels are all white"
    blue = rock[..., 2] / rock[..., 0]
    assert 0.85 < blue.mean() < 0.97, "as warm as the pixels that still have a blue"
    assert blue.max() < 0.99, "no white among the yellow"
    plain = (image < 0.95 * image.max()).all(axis=2)
    alone = Corrector(CONFIG).apply(image[plain][None], range_m[plain][None], CLEAR, exposure=0.6)
    assert (found[plain] == alone.image[0]).all()


@pytest.mark.parametrize("depth", [8, 16])
def test_clipped_spots_have_the_hue_of_the_nearly_clipped_ones_around_them(depth):
    rng = np.random.default_rng(4)
    level = 0.95 * np.exp(0.12 * rng.standard_normal((60, 200, 1)))
    light = np.minimum(level, 1.15) * np.array([1.1, 0.95, 0.95])  # pink
    water = replace(CLEAR, white=np.array([0.6, 1.0, 1.0]))
    image = encoded(light * water.white, depth)
    found = Corrector(CONFIG).apply(image, np.full((60, 200), 2.0, np.float32), water, exposure=0.6)
    clipped = found.unrecoverable & (image[..., 1:] == image.max()).all(axis=2)
    assert 0.1 < clipped.mean() < 0.5
    shown = linear(found.image)[clipped]
    assert (shown[:, 1] / shown[:, 0]).mean() == pytest.approx(0.95 / 1.1, abs=0.05)  # gray: 1


def test_where_noise_stops_a_channel_the_others_stand_in(monkeypatch):
    monkeypatch.setattr(water_gains, "OUTPUT_NOISE", LIMIT)
    range_m = np.tile(np.linspace(1, 12, 300, dtype=np.float32), (4, 1))
    water = replace(CLEAR, y=np.array([0.6, 0.08, 0.05]))
    light = 0.3 * water.attenuation(range_m)
    found = Corrector(ColorConfig()).apply(encoded(light, 16), range_m, water, exposure=1.0)
    shown = linear(found.image)[0]
    lost = found.unrecoverable[0]
    assert not lost[0]
    assert lost[-1]
    assert np.abs(shown[lost] / 0.3 - 1).max() < 0.04, (
        "gray, not cyan; a level of range is up to 0.8 % wide"
    )


@pytest.mark.slow
def test_frames_of_a_survey_share_their_roll_off():
    corrector = Corrector(ColorConfig(lock="survey"))
    fitter = corrector.survey_fitter()
    for i, median in enumerate((0.01, 0.02)):
        image, _ = scene(median)
        range_m = np.tile(np.linspace(1, 3, image.shape[1], dtype=np.float32), (image.shape[0], 1))
        fitter.add(str(i), corrector.measure(image, range_m))
    first, second = fitter.waters().values()
    assert first.exposure == second.exposure is not None
    assert first.highlights == second.highlights > 1
    assert corrector.apply(image, range_m, second).highlights == first.highlights


@pytest.mark.parametrize("strays", [0.001, 0.01])
def test_a_few_wrong_ranges_far_away_do_not_darken_a_picture(strays: float) -> None:
    rng = np.random.default_rng(1)
    image = rng.integers(60, 200, (100, 100, 3), dtype=np.uint8)
    range_m = np.full((100, 100), 2.0, np.float32)
    water = replace(CLEAR, y=np.full(3, 1.0))
    true = Corrector(CONFIG).apply(image, range_m, water).exposure
    range_m.flat[: int(strays * range_m.size)] = 8.0
    assert Corrector(CONFIG).apply(image, range_m, water).exposure == pytest.approx(true, rel=0.05)
