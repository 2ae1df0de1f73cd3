"""The color core as functions: arrays and tensors, single frames and batches, what is refused, how
results read.
"""

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from stereo_seecolor.color import ColorConfig, Corrector, correct, fit
from stereo_seecolor.errors import ColorError
from stereo_seecolor.extras.evaluation.baselines import gray_world, sea_thru

Array = NDArray[np.float64]


def frame(seed: int = 0, dtype: type = np.uint8) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:60, :80]
    range_m = (1.5 + 0.02 * x + 0.3 * np.sin(y / 9 + seed)).astype(np.float32)
    z = range_m[..., None]
    light = rng.beta(2, 3, (60, 80, 3)) * np.exp(-z * [0.4, 0.1, 0.08]) * [
        0.5,
        0.8,
        0.9,
    ] + 0.05 * -np.expm1(-0.3 * z)
    range_m[:5] = np.nan
    return (light ** (1 / 2.2) * np.iinfo(dtype).max).astype(dtype), range_m


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_a_frame_is_what_the_corrector_makes_of_it(dtype: type) -> None:
    image, range_m = frame(dtype=dtype)
    corrector = Corrector(ColorConfig())
    water = fit(image, range_m)
    assert water.content() == corrector.fit_frame(image, range_m).content()
    found, expected = correct(image, range_m), corrector.apply(image, range_m, water)
    assert np.array_equal(found.image, expected.image)
    assert found.exposure == expected.exposure
    assert np.array_equal(correct(image, range_m, water).image, expected.image)


@pytest.mark.parametrize(("bits", "is_said"), [(12, True), (16, False)])
def test_values_of_fewer_bits_are_named(bits: int, is_said: bool) -> None:
    image, range_m = frame(dtype=np.uint16)
    few = image >> (16 - bits)
    batch = np.stack([few, few]), np.stack([range_m, range_m])
    water = fit(few, range_m)
    for found in (water, correct(few, range_m, water), fit(*batch), correct(*batch, water)):
        said = "if the camera has 12 bits, multiply them by 16 " in " ".join(found.warnings)
        assert said == is_said
        assert len({*found.warnings}) == len(found.warnings)


@pytest.mark.parametrize("flat_m", [2.0, 2.3])
def test_a_water_of_the_whole_dive_is_not_to_be_shared(flat_m: float) -> None:
    image, range_m = frame()
    flat = np.geomspace(2.0, flat_m, range_m.size, dtype=np.float32).reshape(range_m.shape)
    said = [fit(image, flat, ColorConfig(lock=lock)).warnings[0] for lock in ("auto", "survey")]
    assert said[0] == f"{said[1]}; use color.lock=survey"


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_tensors_in_tensors_out(dtype: type) -> None:
    image, range_m = frame(dtype=dtype)
    found = correct(torch.from_numpy(image), torch.from_numpy(range_m))
    expected = correct(image, range_m)
    assert isinstance(found.image, torch.Tensor)
    assert found.image.dtype == torch.from_numpy(image).dtype
    assert np.array_equal(found.image.numpy(), expected.image)
    assert np.array_equal(found.unknown.numpy(), expected.unknown)
    assert repr(found).startswith("Correction((60, 80, 3) torch.uint")


@pytest.mark.slow
def test_a_batch_shares_its_water_and_its_exposure() -> None:
    images, ranges = (
        np.stack(parts) for parts in zip(*(frame(seed) for seed in range(3)), strict=True)
    )
    corrector = Corrector(ColorConfig(lock="survey"))
    fitter = corrector.survey_fitter()
    for i, (image, range_m) in enumerate(zip(images, ranges, strict=True)):
        fitter.add(str(i), corrector.measure(image, range_m))
    survey = fitter.waters()["0"]
    np.testing.assert_allclose(fit(images, ranges).y, survey.y)
    found = correct(images, ranges)
    assert found.image.shape == images.shape
    assert found.unknown.shape == ranges.shape
    assert found.exposure == pytest.approx(survey.exposure)
    assert np.array_equal(found.image[1], corrector.apply(images[1], ranges[1], survey).image)
    in_torch = correct(torch.from_numpy(images), torch.from_numpy(ranges))
    assert np.array_equal(in_torch.image.numpy(), found.image)


@pytest.mark.parametrize(
    ("image", "range_m", "message"),
    [
        (
            np.zeros((4, 5, 3)),
            np.ones((4, 5)),
            r"image of shape \(4, 5, 3\) and type float64: needs .* uint8 or uint16",
        ),
        (np.zeros((4, 5), np.uint8), np.ones((4, 5)), r"needs \(H, W, 3\) or \(N, H, W, 3\)"),
        (
            np.zeros((4, 5, 3), np.uint8),
            np.ones((5, 4)),
            r"range of shape \(5, 4\) for an image of shape .*: needs \(4, 5\)",
        ),
        (np.zeros((0, 4, 5, 3), np.uint8), np.ones((0, 4, 5)), "no pixel with a known range"),
        (np.zeros((4, 5, 3), np.uint8), np.full((4, 5), np.nan), "no pixel with a known range"),
        (np.ones((4, 5, 3), np.uint8), np.full((4, 5), 1850, np.uint16), "range of 1850 .*meters"),
    ],
)
def test_what_cannot_be_corrected_is_refused(image: Array, range_m: Array, message: str) -> None:
    with pytest.raises(ColorError, match=message):
        correct(image, range_m)


def test_a_correction_reads_in_one_line() -> None:
    text = repr(correct(*frame()))
    assert text.startswith("Correction((60, 80, 3) uint8, 91.7% known, 0.0")
    assert len(text) < 130


@pytest.mark.slow
def test_baselines_are_functions() -> None:
    image, range_m = frame()
    for baseline in (gray_world, sea_thru):
        result = baseline(image / 255, range_m.astype(np.float64))
        assert result.shape == image.shape
        means = result[np.isfinite(range_m)].mean(axis=0)
        assert np.ptp(means) < 0.05 * means.mean()
