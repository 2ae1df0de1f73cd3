"""One water for many frames, by the lock; and a camera that changes its exposure."""

import numpy as np
import pytest

from stereo_seecolor.color.corrector import Corrector
from stereo_seecolor.color.render import water_gains
from stereo_seecolor.color.sharing.exposure import Brightness, shorten_exposure
from stereo_seecolor.color.table.counting import measure
from stereo_seecolor.color.table.moment_table import MomentTable
from stereo_seecolor.config import ColorConfig, PaperConfig
from stereo_seecolor.errors import ColorError


def reef(seed, exposure=1.0, altitude_m=2.0, shape=(60, 80)):
    """A frame of one reef through one water, linear light as it is."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[: shape[0], : shape[1]]
    range_m = (altitude_m + 0.6 * np.sin(x / 9 + seed) + y / 60).astype(np.float32)
    scene = rng.beta(2, 3, (*shape, 1)) * rng.uniform(0.6, 1, (*shape, 3))
    z = range_m[..., None]
    light = scene * np.exp(-np.array([0.4, 0.1, 0.08]) * z) * [0.5, 0.8, 0.9] + np.array(
        [0.01, 0.05, 0.07]
    ) * (1 - np.exp(-0.3 * z))
    return np.clip(light * exposure * 255 + 0.5, 0, 255).astype(np.uint8), range_m


def waters_of(frames, **settings):
    corrector = Corrector(ColorConfig(input_encoding="as-is", **settings))
    fitter = corrector.survey_fitter()
    for i, (image, range_m) in enumerate(frames):
        fitter.add(str(i), corrector.measure(image, range_m))
    return corrector, fitter.waters()


def same(a, b):
    return (
        np.array_equal(a.w, b.w)
        and np.array_equal(a.gamma_inf, b.gamma_inf)
        and a.exposure == b.exposure
    )


@pytest.mark.slow
@pytest.mark.parametrize("method", ["robust", "paper"])
def test_survey_lock_is_the_fit_to_all_pixels_together(method):
    frames = [reef(seed) for seed in range(4)]
    few = PaperConfig(iterations=100)
    corrector, waters = waters_of(frames, lock="survey", method=method, paper=few)
    together = Corrector(corrector.config.of_dive()).fit(
        measure(np.vstack([f[0] for f in frames]), np.vstack([f[1] for f in frames]))
    )
    assert list(waters) == ["0", "1", "2", "3"]
    for water in waters.values():
        assert np.array_equal(water.w, together.w)
        assert water.exposure == waters["0"].exposure is not None


def test_survey_lock_does_not_depend_on_the_order_of_the_frames():
    frames = [reef(seed) for seed in range(4)]
    _, forward = waters_of(frames, lock="survey")
    _, backward = waters_of(frames[::-1], lock="survey")
    assert same(forward["0"], backward["3"])


def test_each_frame_its_own_water_and_exposure():
    _, waters = waters_of([reef(0), reef(1)], lock="frame")
    assert not same(waters["0"], waters["1"])
    assert waters["0"].exposure is None


def test_sliding_lock_is_the_fit_to_the_last_frames():
    frames = [reef(seed) for seed in range(4)]
    corrector, waters = waters_of(frames, lock=2)
    last_two = measure(
        np.vstack([frames[2][0], frames[3][0]]), np.vstack([frames[2][1], frames[3][1]])
    )
    of_dive = Corrector(corrector.config.of_dive())
    # begun from another water
    assert np.allclose(waters["3"].w, of_dive.fit(last_two).w, atol=2e-3)


def test_the_brightest_of_a_dive_may_be_sand_and_of_a_single_image_white():
    """A warmer content leaves a white point with less red and more blue."""

    def red_over_blue(lock, brightest="auto"):
        _, waters = waters_of([reef(0)], lock=lock, robust={"brightest": brightest})
        return waters["0"].white[0] / waters["0"].white[2]

    white, mixed, sand = (red_over_blue("survey", each) for each in ("white", "mixed", "sand"))
    assert white > 1.03 * mixed > 1.06 * sand
    assert red_over_blue("survey") == red_over_blue("auto") == mixed
    assert red_over_blue("frame") == white
    assert red_over_blue("frame", "sand") == sand


def test_a_jump_of_exposure_is_followed_and_named_and_left_out_of_the_water(monkeypatch):
    frames = [reef(seed) for seed in range(5)]
    _, steady = waters_of(frames, lock="survey")
    corrector, waters = waters_of([*frames, reef(5, exposure=0.01)], lock="survey")
    assert same(waters["0"], steady["0"])
    assert waters["0"].warnings == steady["0"].warnings
    assert any("another camera exposure" in warning for warning in waters["5"].warnings)
    assert (waters["5"].white / waters["0"].white)[1:] == pytest.approx(0.01, rel=0.5)
    image, range_m = reef(5, exposure=0.01)
    # a hundred times the noise
    assert corrector.apply(image, range_m, waters["5"]).unrecoverable.all()
    monkeypatch.setattr(water_gains, "INPUT_NOISE", 1e-9)
    uncapped = Corrector(ColorConfig(input_encoding="as-is"))
    bright = uncapped.apply(*reef(5), waters["0"]).image.mean()
    assert uncapped.apply(image, range_m, waters["5"]).image.mean() == pytest.approx(
        bright, rel=0.5
    )


def test_a_camera_that_exposes_by_itself_is_followed():
    factors = [1.0, 0.7, 0.5, 0.8, 1.2]
    corrector, waters = waters_of(
        [reef(i, e) for i, e in enumerate(factors)], lock="survey", camera_exposure="brightness"
    )
    relative = np.array([waters[str(i)].white[1] for i in range(5)])
    assert relative / relative[0] == pytest.approx(factors, rel=0.06)
    brightness = [
        corrector.apply(*reef(i, e), waters[str(i)]).image.mean() for i, e in enumerate(factors)
    ]
    assert np.ptp(brightness) < 0.06 * np.mean(brightness)


@pytest.mark.parametrize("lock", ["auto", "frame", 20, "survey"])
def test_frames_without_a_known_range_get_another_s_water(lock):
    image, range_m = reef(0)
    nothing = np.full_like(range_m, np.nan)
    _, waters = waters_of([(image, nothing), (image, range_m), (image, nothing)], lock=lock)
    for empty in (waters["0"], waters["2"]):
        assert same(empty, waters["1"])
        assert not empty.warnings
    assert not waters["1"].warnings


def test_black_frames_get_the_survey_s_water():
    image, range_m = reef(0)
    _, waters = waters_of([(image * 0, range_m), (image, range_m)], lock="survey")
    assert same(waters["0"], waters["1"])


@pytest.mark.slow
@pytest.mark.parametrize("lock", ["auto", "frame", 20, "survey"])
def test_a_dive_without_light_says_so_in_every_frame(lock):
    image, range_m = reef(0)
    _, waters = waters_of([(image * 0, range_m)] * 2, lock=lock)
    assert all(
        "the frame is black where the range is known" in water.warnings[0]
        for water in waters.values()
    )


@pytest.mark.parametrize("lock", ["auto", "frame", 20, "survey"])
def test_a_dive_without_a_known_range_is_refused(lock):
    image, range_m = reef(0)
    with pytest.raises(ColorError, match="none of the 2 frames has a pixel with a known range"):
        waters_of([(image, np.full_like(range_m, np.nan))] * 2, lock=lock)
    assert Corrector(ColorConfig(lock=lock)).survey_fitter().waters() == {}


def test_darkening_a_table_is_the_table_of_a_darker_image():
    image, range_m = reef(1)
    table = measure(image, range_m)
    half = shorten_exposure(table, 2.0, "as-is")
    mean = half.counts.sum(axis=(0, 1)) @ half.values / half.counts.sum()
    assert mean == pytest.approx(
        0.5 * (table.counts.sum(axis=(0, 1)) @ table.values / table.counts.sum()), rel=0.02
    )
    assert Brightness.of(table, "as-is").ratio(Brightness.of(half, "as-is")) == pytest.approx(
        2, rel=0.02
    )
    assert Brightness.of(MomentTable.empty(), "as-is").ratio(Brightness.of(table, "as-is")) == 1.0
