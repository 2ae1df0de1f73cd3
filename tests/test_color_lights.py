"""The rig's own light: learned from many frames, it comes out of the picture; the reef and the water stay in."""

import numpy as np
import pytest
from numpy.typing import NDArray

from stereo_seecolor.color.photometry.lights import GRID, LightField, even_light, learn_light
from stereo_seecolor.errors import ColorError
from stereo_seecolor.records import Image, Map
from stereo_seecolor.synthetic.render import Scene
from stereo_seecolor.synthetic.survey import SurveySpec

SIZE = (96, 128)
Y, X = np.meshgrid(np.linspace(-1, 1, SIZE[0]), np.linspace(-1, 1, SIZE[1]), indexing="ij")
PATTERN = np.exp(-0.5 * ((X - 0.2) ** 2 + Y**2))


def frame_under(pattern: NDArray[np.float64], seed: int, fall_off: float = 2.0) -> tuple[Image, Map]:
    """A random reef under a lamp, seen by a camera that looks ahead: the upper part is farther. 16-bit linear."""
    rng = np.random.default_rng(seed)
    reef = np.kron(rng.uniform(0.05, 0.5, (12, 16, 3)), np.ones((8, 8, 1)))
    relief = np.kron(rng.uniform(-0.2, 0.2, (6, 8)), np.ones((16, 16)))
    range_m = rng.uniform(1.5, 2.8) * (1 - 0.25 * Y) + relief
    light = 0.8 * reef * (pattern * (1.5 / range_m) ** fall_off)[..., None]
    return np.round(np.clip(light, 0, 1) * 65535).astype(np.uint16), range_m.astype(np.float32)


def test_pattern_is_found_under_a_tilted_camera() -> None:
    field = learn_light([frame_under(PATTERN, seed) for seed in range(60)], "linear")
    truth = PATTERN[SIZE[0] // GRID[0] // 2 :: SIZE[0] // GRID[0], SIZE[1] // GRID[1] // 2 :: SIZE[1] // GRID[1]]
    off = field.pattern / (truth / truth.mean()) - 1
    assert np.abs(off).max() < 0.12
    assert off.std() < 0.04


def test_light_taken_out_leaves_the_reef() -> None:
    field = learn_light([frame_under(PATTERN, seed) for seed in range(60)], "linear")
    image, range_m = frame_under(PATTERN, 100)
    even = frame_under(np.ones(SIZE), 100, fall_off=0.0)[0].astype(float)
    found = even_light(image, range_m, field, "linear").astype(float)
    ratio = found / even / np.median(found / even)
    assert ratio.std() < 0.06
    assert (image / even).std() / np.median(image / even) > 0.2


def test_no_pattern_and_no_fall_off_change_nothing() -> None:
    field = LightField(np.ones(GRID), reference_m=2.0, fall_off=0.0)
    rng = np.random.default_rng(0)
    for dtype, encoding in ((np.uint8, "srgb"), (np.uint8, "as-is"), (np.uint16, "linear")):
        image = rng.integers(0, np.iinfo(dtype).max, (*SIZE, 3), dtype=dtype, endpoint=True)
        range_m = np.full(SIZE, np.nan, np.float32)
        assert np.array_equal(even_light(image, range_m, field, encoding), image)  # type: ignore[arg-type]


def test_unknown_ranges_leave_the_light_finite() -> None:
    frames = []
    for seed in range(20):
        image, range_m = frame_under(PATTERN, seed)
        range_m[:, :40] = np.nan
        frames.append((image, range_m))
    field = learn_light(frames, "linear")
    assert np.isfinite(field.pattern).all()
    assert np.isfinite(field.light(frames[0][1])).all()


def test_too_little_to_learn_from() -> None:
    with pytest.raises(ColorError, match="only 3 frames"):
        learn_light([frame_under(PATTERN, seed) for seed in range(3)], "linear")
    blind = [(image, np.full_like(range_m, np.nan)) for image, range_m in (frame_under(PATTERN, seed) for seed in range(12))]
    with pytest.raises(ColorError, match="no part of the picture"):
        learn_light(blind, "linear")


@pytest.mark.slow
def test_lamps_of_a_rendered_dive_come_out() -> None:
    """Against the reef without any water or lamp, light across the frame varies less than half as much as before."""
    scene = Scene.from_spec(SurveySpec(pairs=16, image_size=(128, 104), lamp_intensity=200.0, bits=16))
    pairs = [scene.render(index) for index in range(16)]
    field = learn_light([(pair.rectified.left, pair.range_map.range_m) for pair in pairs], "linear")

    def unevenness(image: Image, index: int) -> float:
        truth = pairs[index]
        water = scene.water.water
        direct = image / 65535 - water.backscatter(truth.range_map.range_m)
        light = (direct / np.maximum(truth.color, 0.02) / water.attenuation(truth.range_map.range_m))[..., 1]
        coarse = light[:104, :128].reshape(8, 13, 8, 16).mean(axis=(1, 3))
        return float(coarse.std() / coarse.mean())

    for index in (2, 13):
        raw, range_m = pairs[index].rectified.left, pairs[index].range_map.range_m
        assert unevenness(even_light(raw, range_m, field, "linear"), index) < 0.5 * unevenness(raw, index)
