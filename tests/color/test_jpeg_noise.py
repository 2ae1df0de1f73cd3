"""The response of cameras from the noise that JPEG compression leaves."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from cameras import Camera, drawn_light

from stereo_seecolor.checks.camera_response import settle_response
from stereo_seecolor.color.response.jpeg_noise import jpeg_noise_curve
from stereo_seecolor.color.response.measure import measure_jpeg
from stereo_seecolor.config import RunConfig
from stereo_seecolor.files.image_headers import jpeg_quantization
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.records import Image

LIGHT = [drawn_light(seed, (960, 720)) for seed in range(4)]


def compressed(image: Image, quality: int) -> bytes:
    return cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()


def decoded(content: bytes) -> Image:
    found: Image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    return found


@pytest.mark.parametrize(("quality", "sigma"), [(98, 1.5), (95, 3.0), (90, 5.0), (80, 9.0)])
def test_noise_before_quantization_is_found(quality: int, sigma: float) -> None:
    """A slope of gray with noise of one variance everywhere, rounded before and after."""
    rng = np.random.default_rng(1)
    slope = np.linspace(60, 190, 1200)[None, :, None] + np.zeros((900, 1, 1))
    image = np.clip(slope + rng.normal(0, sigma, (900, 1200, 1)), 1, 249)
    content = compressed(np.round(image).astype(np.uint8).repeat(3, axis=2), quality)
    curve = jpeg_noise_curve([decoded(content)], jpeg_quantization(content))
    assert curve is not None
    np.testing.assert_allclose(curve.variance, sigma**2 + 1 / 6, rtol=0.2)
    assert curve.variance.mean() == pytest.approx(sigma**2 + 1 / 6, rel=0.06)


@pytest.mark.slow
@pytest.mark.parametrize(("quality", "mosaic"), [(95, False), (90, False), (95, True)])
def test_encoded_jpegs_are_recognized_and_linear_ones_are_doubted(
    quality: int, mosaic: bool
) -> None:
    found = {}
    for curve in ("linear", "srgb", "gamma 1.8"):
        camera = Camera(electrons=1500, curve=curve, mosaic=mosaic)
        files = [compressed(camera.shoot(light, seed), quality) for seed, light in enumerate(LIGHT)]
        found[curve] = measure_jpeg([decoded(file) for file in files], jpeg_quantization(files[0]))
    assert found["srgb"].verdict == found["gamma 1.8"].verdict == "encoded"
    assert found["linear"].verdict == "undecided"
    assert "fits linear light better, by a factor of" in found["linear"].line


def test_without_noise_nothing_is_said() -> None:
    files = [compressed(np.round(255 * light).astype(np.uint8), 90) for light in LIGHT[:2]]
    steps = jpeg_quantization(files[0])
    assert measure_jpeg([decoded(file) for file in files], steps).line.startswith("not measurable")
    for side in (40, 7):
        assert jpeg_noise_curve([np.full((side, side, 3), 90, np.uint8)], steps) is None


@pytest.mark.slow
def test_a_dive_of_jpegs_has_the_note(tmp_path: Path) -> None:
    camera, pairs = Camera(electrons=1500), []
    for seed, light in enumerate(LIGHT):
        path = tmp_path / f"{seed}.jpg"
        path.write_bytes(compressed(camera.shoot(light, seed), 95))
        pairs.append(Pair(path.stem, path, path))
    config, notes = settle_response(RunConfig(), pairs)
    assert config.color.input_encoding == "unknown"
    assert any("noise that JPEG compression left fits linear light" in note for note in notes)
    (tmp_path / "0.jpg").write_bytes(compressed(camera.shoot(LIGHT[0]), 90))  # others are of 95
    assert any("not measurable" in note for note in settle_response(RunConfig(), pairs)[1])
