"""Sand alone in view, as in a thread of a user whose pictures turned red: nothing there is red, and
nothing becomes so.
"""

import numpy as np
import pytest

from stereo_seecolor.color.corrector import Corrector
from stereo_seecolor.color.photometry.light_model import TERMS, Light
from stereo_seecolor.config import ColorConfig
from stereo_seecolor.files.srgb import encode_srgb

SAND = np.array([0.45, 0.40, 0.33])
LIGHT, INFINITY = np.array([0.35, 0.9, 1.0]), np.array([0.02, 0.16, 0.24])
BEAM, BACKSCATTER = np.array([0.38, 0.09, 0.06]), np.array([0.32, 0.10, 0.08])


@pytest.mark.parametrize("depths_m", [(4.0, 4.0), (6.0, 2.0)])
def test_sand_alone_gets_no_red_cast(depths_m: tuple[float, float]) -> None:
    rng = np.random.default_rng(1)
    range_m = np.linspace(*depths_m, 180, dtype=np.float32)[:, None] * np.ones((1, 240), np.float32)
    reflectance = SAND * (1 + 0.12 * rng.normal(0, 1, (180, 240, 1)))
    direct = reflectance * np.exp(-BEAM * range_m[..., None]) * LIGHT
    seen = direct + INFINITY * (1 - np.exp(-BACKSCATTER * range_m[..., None]))
    image = np.clip(
        255 * encode_srgb(np.clip(seen, 0, 1)) + rng.normal(0, 1, seen.shape), 0, 255
    ).astype(np.uint8)
    corrector = Corrector()
    water = corrector.fit(corrector.measure(image, range_m))
    red, green, blue = corrector.apply(image, range_m, water).image.reshape(-1, 3).mean(axis=0)
    assert image[..., 0].mean() < 0.5 * image[..., 1].mean()  # what the camera saw
    assert 0.85 * green < red < 1.12 * green and blue < 1.05 * green


@pytest.mark.slow
def test_the_white_of_lamps_is_not_that_of_a_depth() -> None:
    """Lamps have a prior of their own."""
    rng = np.random.default_rng(2)
    range_m = np.full((120, 160), 1.5, np.float32) + np.linspace(0, 0.5, 160, dtype=np.float32)
    seen = SAND * np.exp(-2 * BEAM * range_m[..., None] + 0.3 * rng.normal(0, 1, (120, 160, 1)))
    image = np.round(255 * encode_srgb(np.clip(2 * seen, 0, 1))).astype(np.uint8)
    config = ColorConfig(lock="survey")
    by_day, by_lamps = (
        Light(np.zeros((TERMS, 3)), 1.7, (1.0, 2.0), {}, fade=fade) for fade in (0.5, 2.0)
    )
    whites = []
    for light in (by_day, by_lamps):
        fitter = Corrector(config).survey_fitter(light)
        fitter.add("1", Corrector(config).measure(image, range_m))
        whites.append(fitter.waters()["1"].white)
    off = [np.ptp(np.log(white)) for white in whites]  # of gray, as these lamps are
    assert off[1] < 0.8 * off[0]
