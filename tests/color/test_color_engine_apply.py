"""Taking water out: the formula at every pixel, both depths, all encodings, the exposure, the cap,
and broken frames.
"""

from dataclasses import replace
from unittest import mock

import numpy as np
import pytest
from color_waters import clear_water
from hypothesis import given, settings
from hypothesis import strategies as st

from stereo_seecolor.color.corrector import Corrector
from stereo_seecolor.color.render import water_gains
from stereo_seecolor.color.render.water_gains import fine_ranges_m
from stereo_seecolor.color.table.encoding import decode, encode
from stereo_seecolor.config import ColorConfig, PaperConfig
from stereo_seecolor.errors import ColorError
from stereo_seecolor.extras.evaluation.measures import angle_deg
from stereo_seecolor.records import Water

ENCODINGS = ["srgb", "linear", "as-is"]


def some_water(encoding="srgb", seed=0):
    rng = np.random.default_rng(seed)
    veil = {
        "gamma_inf": rng.uniform(0.01, 0.2, 3),
        "beta": rng.uniform(0.05, 0.5, 3),
        "eta": rng.uniform(0, 0.02, 3),
        "alpha": np.ones(3),
    }
    dimming = {
        "w": rng.uniform(0.05, 0.4, 3),
        "v": rng.uniform(0, 0.1, 3),
        "y": rng.uniform(0, 0.2, 3),
        "x": rng.uniform(0, 1, 3),
    }
    return Water(**veil, **dimming, white=rng.uniform(0.3, 1, 3), input_encoding=encoding)


def noise_of(fraction):
    """A camera of that noise, and a backscatter of no more error."""
    return mock.patch.multiple(water_gains, INPUT_NOISE=fraction, BACKSCATTER_ERROR=fraction)


def random_frame(seed, depth=8, shape=(40, 60)):
    rng = np.random.default_rng(seed)
    image = rng.integers(0, 2**depth, (*shape, 3)).astype(np.uint8 if depth == 8 else np.uint16)
    range_m = rng.uniform(0.3, 8, shape).astype(np.float32)
    range_m[rng.random(shape) < 0.2] = rng.choice([np.nan, np.inf, -np.inf, 0, -2])
    return image, range_m


@pytest.mark.slow
@given(st.integers(0, 2**32 - 1), st.sampled_from([8, 16]), st.sampled_from(ENCODINGS))
@settings(max_examples=30)
def test_every_pixel_is_the_model_turned_round(seed, depth, encoding):
    image, range_m = random_frame(seed, depth)
    known = np.isfinite(range_m) & (range_m > 0)
    centers = fine_ranges_m().astype(np.float32)  # where a level's gain is the range's own
    range_m[known] = centers[np.searchsorted(centers, range_m[known])]
    water = some_water(encoding, seed)
    corrector = Corrector(ColorConfig(input_encoding=encoding))
    full = 2**depth - 1
    z = np.where(known, range_m, 1.0)
    truth = (
        0.7
        * (decode(image / full, encoding) - water.backscatter(z))
        / (water.attenuation(z) * water.white)
    )

    with noise_of(1e-9):
        found = corrector.apply(image, range_m, water, exposure=0.7)
        linear = corrector.apply_linear(image, range_m, water, exposure=0.7)
    unclipped = known & (image < 0.95 * full).all(axis=2)
    off = np.abs(found.image - full * encode(np.clip(truth, 0, 1), encoding))[unclipped]
    assert off.max() < (0.7 if depth == 8 else 1.5)  # a half is rounding
    assert (found.image[~known] == 0).all()
    assert np.array_equal(found.unknown, ~known)
    assert found.image.dtype == image.dtype

    assert linear.dtype == np.float32
    assert np.allclose(linear[known], truth[known], rtol=1e-5, atol=1e-5)
    assert (linear[~known] == 0).all()


MATRIX = np.array([[1.4, -0.3, -0.1], [-0.2, 1.5, -0.3], [0.05, -0.45, 1.4]])


@pytest.mark.parametrize("depth", [8, 16])
def test_a_color_matrix_mixes_the_corrected_light(depth):
    image, range_m = random_frame(4, depth)
    full, water = 2**depth - 1, some_water()
    corrector = Corrector(ColorConfig(unknown_pixels="black"))
    with noise_of(1e-9):
        plain = corrector.apply_linear(image, range_m, water, exposure=0.7)
        mixed = corrector.apply_linear(image, range_m, replace(water, matrix=MATRIX), exposure=0.7)
        found = corrector.apply(image, range_m, replace(water, matrix=MATRIX), exposure=0.7)
    np.testing.assert_allclose(mixed, plain @ MATRIX.T, rtol=1e-4, atol=1e-5)
    unclipped = ~found.unknown & (image < 0.95 * full).all(axis=2)
    off = np.abs(found.image - full * encode(np.clip(mixed, 0, 1).astype(np.float64), "srgb"))[
        unclipped
    ]
    assert off.max() < (0.7 if depth == 8 else 1.5)
    assert (found.image[found.unknown] == 0).all()


def test_a_color_matrix_leaves_gray_and_counts_its_noise():
    gray = np.full((8, 8, 3), 90, np.uint8)
    clear, range_m = clear_water("srgb"), np.full((8, 8), 2.0, np.float32)
    corrector = Corrector(ColorConfig())
    same, mixed = (
        corrector.apply(gray, range_m, replace(clear, matrix=m), exposure=1.0).image
        for m in (np.eye(3), MATRIX)
    )
    assert np.array_equal(same, mixed)
    dark = replace(clear, white=np.array([0.05, 1.0, 1.0]))
    capped = [
        corrector.apply(gray, range_m, replace(dark, matrix=m), exposure=1.0).unrecoverable
        for m in (np.eye(3), MATRIX)
    ]
    assert capped[1].sum() >= capped[0].sum()


@pytest.mark.parametrize("depth", [8, 16])
def test_what_noise_hides_comes_out_gray_and_the_rest_as_it_is(depth):
    """Red gets six times the gain of blue: black with its noise would come out in red and cyan
    speckles.
    """
    rng, full = np.random.default_rng(8), 2**depth - 1
    water = replace(
        clear_water("srgb"),
        gamma_inf=np.array([0.02, 0.04, 0.04]),
        beta=np.ones(3),
        white=np.array([0.15, 0.6, 0.9]),
    )
    range_m = np.full((60, 60), 3.0, np.float32)

    def seen(light):
        camera = encode(
            water.backscatter(range_m) + light * water.white, "srgb"
        ) + 0.006 * rng.standard_normal((60, 60, 3))
        return np.round(np.clip(camera, 0, 1) * full).astype(np.uint8 if depth == 8 else np.uint16)

    def corrected(light, noise):
        with noise_of(noise):
            return Corrector().apply(seen(light), range_m, water, exposure=1.0).image / full

    black, gray = ([corrected(light, noise) for noise in (0.006, 1e-9)] for light in (0, 0.3))
    color, before = (angle_deg(image + 1e-3, np.ones(3)).mean() for image in black)
    assert color < 0.4 * before
    assert abs(gray[0].mean() - gray[1].mean()) < 0.005


def test_between_the_levels_the_range_is_off_by_four_thousandths_at_most():
    centers = fine_ranges_m()
    assert (np.diff(centers) / centers[:-1]).max() < 0.008


@pytest.mark.parametrize("depth", [8, 16])
@pytest.mark.parametrize("encoding", ENCODINGS)
def test_clear_water_at_exposure_one_changes_nothing(depth, encoding):
    config = ColorConfig(input_encoding=encoding)
    image, range_m = random_frame(7, depth)
    found = Corrector(config).apply(image, range_m, clear_water(encoding), exposure=1.0)
    expected = image if encoding != "linear" else None
    if expected is None:
        full = 2**depth - 1
        expected = encode(image / full, "srgb") * full
    difference = np.abs(found.image.astype(int) - expected)[~found.unknown]
    assert difference.max() <= (1 if depth == 8 or encoding == "as-is" else 2)


@pytest.mark.parametrize("depth", [8, 16])
def test_exposure_lets_no_more_than_one_pixel_in_two_thousand_clip(depth, monkeypatch):
    rng = np.random.default_rng(3)
    image = (rng.gamma(2, 0.08, (150, 200, 3)).clip(0, 0.9) * (2**depth - 1)).astype(
        np.uint8 if depth == 8 else np.uint16
    )
    range_m = rng.uniform(1, 3, (150, 200)).astype(np.float32)
    monkeypatch.setattr(water_gains, "OUTPUT_NOISE", 1e9)
    config = ColorConfig(median_luminance=0.5)
    found = Corrector(config).apply(image, range_m, some_water())
    full = 2**depth - 1
    assert found.clipped_fraction == pytest.approx((found.image == full).any(axis=2).mean())
    assert found.clipped_fraction <= 0.0005
    assert found.image.max() > 0.9 * full


def test_gain_stops_where_noise_would_pass_the_stated_level_and_says_where(monkeypatch):
    rng = np.random.default_rng(4)
    range_m = np.tile(np.linspace(0.5, 12, 400, dtype=np.float32), (50, 1))
    image = rng.integers(100, 140, (50, 400, 3)).astype(np.uint8)
    water = replace(clear_water("srgb"), w=np.array([1.0, 0.1, 0.1]))
    found = Corrector().apply(image, range_m, water, exposure=1.0)
    assert found.unrecoverable[:, -1].all()
    assert not found.unrecoverable[:, 0].any()
    begins = found.unrecoverable[0].argmax()
    gain = np.exp(range_m[0, begins])
    seen = encode(0.18 / gain, "srgb")  # a mid-gray surface there, as the camera encodes it
    darker, brighter = decode(seen + np.array([-0.003, 0.003]), "srgb")
    slope = (brighter - darker) / 0.006
    assert gain * slope * 0.006 == pytest.approx(water_gains.OUTPUT_NOISE, rel=0.1)
    monkeypatch.setattr(water_gains, "OUTPUT_NOISE", 1e9)
    free = Corrector().apply(image, range_m, water, exposure=1.0)
    assert not free.unrecoverable.any()


def test_gain_stops_where_an_error_of_the_backscatter_would_pass_the_stated_level(monkeypatch):
    monkeypatch.setattr(water_gains, "INPUT_NOISE", 1e-9)
    range_m = np.tile(np.linspace(0.5, 12, 400, dtype=np.float32), (4, 1))
    gamma_inf, fade = np.array([0.1, 0.2, 0.3]), np.full(3, 0.4)
    water = replace(clear_water("srgb"), gamma_inf=gamma_inf, beta=fade, w=fade)
    seen = water.backscatter(range_m) * [1.04, 0.96, 1.02]  # of black rock; within the error
    image = np.rint(65535 * encode(seen, "srgb")).astype(np.uint16)
    found = Corrector().apply(image, range_m, water, exposure=1.0)
    begins = found.unrecoverable[0].argmax()
    veil = gamma_inf.max() * (1 - np.exp(-0.4 * range_m[0, begins]))
    error = water_gains.BACKSCATTER_ERROR * veil * np.exp(0.4 * range_m[0, begins])
    assert error == pytest.approx(water_gains.OUTPUT_NOISE, rel=0.02)
    light = decode(found.image / 65535, "srgb")
    assert light.max() < 2 * water_gains.OUTPUT_NOISE
    monkeypatch.setattr(water_gains, "BACKSCATTER_ERROR", 1e-9)
    believed = decode(Corrector().apply(image, range_m, water, exposure=1.0).image / 65535, "srgb")
    assert believed[0, -1].max() > 5 * light[0, -1].max()


@pytest.mark.slow
def test_unknown_pixels_can_be_left_as_they_were():
    image, range_m = random_frame(5)
    found = Corrector(ColorConfig(unknown_pixels="raw")).apply(image, range_m, some_water())
    assert np.array_equal(found.image[found.unknown], image[found.unknown])


def test_water_of_another_encoding_is_refused():
    image, range_m = random_frame(6)
    with pytest.raises(ColorError, match=r"set color\.input_encoding=as-is"):
        Corrector(ColorConfig()).apply(image, range_m, some_water("as-is"))


def broken_frames():
    rng = np.random.default_rng(8)
    image, range_m = (
        rng.integers(0, 256, (30, 40, 3)).astype(np.uint8),
        rng.uniform(1, 5, (30, 40)).astype(np.float32),
    )
    single = np.full_like(range_m, np.nan)
    single[3, 4] = 2.0
    infinite = range_m.copy()
    infinite[::2], infinite[::3] = np.inf, np.nan
    yield "all unknown", image, np.full_like(range_m, np.nan)
    yield "one level", image, np.full_like(range_m, 2.0)
    yield "black", np.zeros_like(image), range_m
    yield "blown", np.full_like(image, 255), range_m
    yield "one valid pixel", image, single
    yield "2x2", image[:2, :2], range_m[:2, :2]
    yield "1x1", image[:1, :1], range_m[:1, :1]
    yield "NaN and infinities", image, infinite
    yield (
        "very near and very far",
        image,
        np.where(range_m > 3, np.float32(1e-30), np.float32(1e30)),
    )
    yield "gray", np.repeat(image[..., :1], 3, axis=2), range_m
    yield "no red", image * np.array([0, 1, 1], np.uint8), range_m


@pytest.mark.slow
@pytest.mark.parametrize("method", ["robust", "paper"])
@pytest.mark.parametrize("depth", [8, 16])
@pytest.mark.parametrize(
    ("name", "image", "range_m"), [pytest.param(*frame, id=frame[0]) for frame in broken_frames()]
)
def test_broken_frames_give_a_picture_or_a_warning(method, depth, name, image, range_m):
    few, corrector = (
        Corrector(ColorConfig(method=method, paper=PaperConfig(iterations=steps)))
        for steps in (30, 150 if depth == 8 else 30)
    )
    image = image if depth == 8 else image.astype(np.uint16) * 257
    if name == "all unknown":
        with pytest.raises(
            ColorError, match="no pixel with a known range: there is nothing to fit"
        ):
            corrector.fit_frame(image, range_m)
        found = corrector.apply(image, range_m, some_water())
        assert not found.image.any()
        assert found.warnings == ("no pixel with a known range: the image is empty",)
        return
    water = corrector.fit_frame(image, range_m)
    again = few.fit_frame(image, range_m, start=water)
    for one in (water, again):
        found = corrector.apply(image, range_m, one)
        assert found.image.shape == image.shape
        assert found.image.dtype == image.dtype
        assert np.isfinite(found.exposure)
        assert np.isfinite(
            corrector.apply_linear(image, range_m, one, exposure=found.exposure)
        ).all()
        assert all(
            np.isfinite(getattr(one, n)).all()
            for n in ("gamma_inf", "beta", "eta", "alpha", "w", "v", "y", "x", "white")
        )
    if name in ("one level", "black", "blown", "one valid pixel", "2x2", "1x1"):
        assert found.warnings, "nothing can be learned from this frame, and it should say so"


def test_an_underexposed_linear_image_keeps_its_colors():
    """A sensor's noise grows with its light: a twentieth of the light in 16 bits is no noise."""
    water = replace(clear_water("linear"), white=np.array([0.015, 0.05, 0.05]))
    range_m = np.full((20, 20), 2.0, np.float32)
    red = np.array([0.6, 0.2, 0.1])
    image = np.round(np.broadcast_to(red * water.white, (20, 20, 3)) * 65535).astype(np.uint16)
    found = Corrector(ColorConfig(input_encoding="linear")).apply(
        image, range_m, water, exposure=1.0
    )
    assert angle_deg(decode(found.image / 65535, "srgb"), red).max() < 1.0
    assert not found.unrecoverable.any()
