"""Waters from measured absorption and scattering: what is known of natural waters holds of them,
and light adds up.
"""

import numpy as np
import pytest

from benchmarks.measured_waters import (
    WAVELENGTH_NM,
    Contents,
    Kind,
    SpectralWater,
    camera_bands,
    draw_contents,
    draw_water,
)
from stereo_seecolor.water.jerlov import KD_JERLOV, TABLE_NM

RNG = np.random.default_rng(5)
NOTHING = Contents(chlorophyll=0.0, dissolved=0.0)


def at(nm: float, spectrum: np.ndarray) -> float:
    return float(np.interp(nm, WAVELENGTH_NM, spectrum))


def test_the_clearest_water_is_bluest_and_as_clear_as_the_clearest_ocean() -> None:
    diffuse = NOTHING.diffuse_attenuation(0.0)
    assert 400 <= WAVELENGTH_NM[diffuse.argmin()] <= 440
    clearest = KD_JERLOV["I"]  # of all that Jerlov measured; another source than these waters'
    assert at(475, diffuse) == pytest.approx(np.interp(475, TABLE_NM, clearest), rel=0.3)
    assert at(650, diffuse) == pytest.approx(np.interp(650, TABLE_NM, clearest), rel=0.1)
    assert (NOTHING.diffuse_attenuation(50.0) > diffuse).all()


@pytest.mark.parametrize(
    ("kind", "absorption", "scattering"),
    [
        ("coast", 0.179, 0.219),
        ("harbor", 0.366, 1.824),
    ],  # 1/m at 514 nm: Petzold 1972, off California and in San Diego harbor
)
def test_petzold_measured_such_waters(kind: Kind, absorption: float, scattering: float) -> None:
    drawn = [draw_contents(kind, RNG) for _ in range(200)]
    a = np.array([at(514, water.absorption) for water in drawn])
    b = np.array([at(514, sum(water.scattering)) for water in drawn])
    near = (np.abs(np.log(a / absorption)) < 0.7) & (np.abs(np.log(b / scattering)) < 0.7)
    assert near.mean() > 0.05


def test_more_of_anything_dims_every_wavelength() -> None:
    before = Contents(1.0, 0.1, 0.5).diffuse_attenuation(30.0)
    for more in (Contents(2.0, 0.1, 0.5), Contents(1.0, 0.2, 0.5), Contents(1.0, 0.1, 1.0)):
        assert (more.diffuse_attenuation(30.0) > before).all()


def test_one_wavelength_follows_beer_and_lambert() -> None:
    bands = np.zeros((3, WAVELENGTH_NM.size))
    bands[[0, 1, 2], [20, 15, 5]] = 1.0
    beam = Contents(1.0, 0.1).absorption
    water = SpectralWater(
        bands, np.full(WAVELENGTH_NM.size, 0.5), beam, np.full(WAVELENGTH_NM.size, 0.1)
    )
    range_m = np.array([[0.0, 1.0], [2.5, 7.0]])
    expected = np.exp(-range_m[..., None] * beam[[20, 15, 5]])
    np.testing.assert_allclose(water.attenuation(range_m), expected, rtol=1e-12)
    np.testing.assert_allclose(
        water.backscatter(range_m), 0.1 * (1 - expected), rtol=1e-12, atol=1e-15
    )
    np.testing.assert_allclose(water.white, 0.5)


@pytest.mark.parametrize("kind", ["ocean", "coast", "harbor"])
def test_a_channel_loses_less_a_meter_the_farther_it_looks(kind: Kind) -> None:
    water = draw_water(draw_contents(kind, RNG), RNG)
    range_m = np.linspace(0.1, 8, 40)
    rate = -np.log(water.attenuation(range_m)) / range_m[:, None]
    assert (np.diff(rate, axis=0) <= 1e-12).all()
    assert (rate > 0).all()
    veil = water.backscatter(range_m)
    assert (np.diff(veil, axis=0) > 0).all()
    assert veil.max() <= 0.31 * water.white.max()


def test_bands_of_a_camera_are_in_order_and_white_at_the_surface() -> None:
    bands = camera_bands(RNG)
    np.testing.assert_allclose(bands.sum(axis=1), 1.0)
    assert np.all(np.diff(bands @ WAVELENGTH_NM) < 0)
