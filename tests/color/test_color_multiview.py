"""The water from patches seen twice: known waters come back, whatever the reef's colors, moving
light and wrong matches.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from calibration import Rectification, RectifiedPair
from calibration.formats import load_rig
from stereo_seecolor.color.photometry.observations import KeyFrame, Observations
from stereo_seecolor.errors import ColorError
from stereo_seecolor.extras.evaluation.multiview import find_observations, fit_observations
from stereo_seecolor.extras.synthetic.waters import WATER_NAMES, WaterName, lit_water
from stereo_seecolor.inputs.images import read_image, read_range_map
from stereo_seecolor.inputs.trajectories import read_trajectory
from stereo_seecolor.records import Water

SAMPLES = Path(__file__).parents[2] / "data_samples" / "reef"
RANGES_M = (1.2, 3.2)


def water_named(name: WaterName) -> Water:
    return lit_water(name, 8.0, 6.0, 1.5).water


def sightings_through(
    water: Water, colors: NDArray[np.float64], noise: float = 0.003, each: int = 5
) -> Observations:
    """Patches (P, 3) of these linear colors seen ``each`` times, in as many frames, at random
    ranges.
    """
    rng = np.random.default_rng(1)
    patch = np.repeat(np.arange(len(colors)), each)
    range_m = rng.uniform(*RANGES_M, patch.size)
    light = colors[patch] * water.white * water.attenuation(range_m) + water.backscatter(range_m)
    light += noise * rng.standard_normal(light.shape)
    frame, pixel = np.tile(np.arange(each), len(colors)), np.zeros((patch.size, 2))
    return Observations(patch, frame, range_m, light, pixel, np.arange(each))


def reef(patches: int = 1500) -> NDArray[np.float64]:
    return np.asarray(np.random.default_rng(2).beta(1.2, 4.0, (patches, 3)))


def rate(water: Water) -> NDArray[np.float64]:
    """(3,) the slope of -log A over the ranges that were seen, 1/m."""
    near, far = water.attenuation(np.array(RANGES_M))
    return np.asarray(np.log(near / far) / (RANGES_M[1] - RANGES_M[0]))


@pytest.mark.slow
@pytest.mark.parametrize("name", WATER_NAMES)
def test_known_water_comes_back(name: WaterName) -> None:
    truth = water_named(name)
    found = fit_observations(sightings_through(truth, reef()), "srgb")
    np.testing.assert_allclose(rate(found), rate(truth), rtol=0.03)
    np.testing.assert_allclose(
        found.backscatter(np.array(2.2)), truth.backscatter(np.array(2.2)), rtol=0.05, atol=5e-4
    )
    assert np.isfinite(found.standard_errors["y"]).all()
    assert np.isnan(found.standard_errors["white"]).all()


@pytest.mark.slow
def test_a_red_reef_gives_the_same_water() -> None:
    """No gray world: what the reef looks like doesn't matter."""
    truth = water_named("coastal-green")
    found = fit_observations(
        sightings_through(truth, reef() * [1.0, 0.25, 0.15] + [0.1, 0.0, 0.0]), "srgb"
    )
    np.testing.assert_allclose(rate(found), rate(truth), rtol=0.06)


@pytest.mark.slow
def test_moving_light_does_not_mislead() -> None:
    truth = water_named("coastal-green")
    clean = sightings_through(truth, reef(1500))
    flicker = np.exp(0.3 * np.random.default_rng(3).standard_normal((clean.patch.size, 1)))
    veil = truth.backscatter(clean.range_m)
    found = fit_observations(replace(clean, light=(clean.light - veil) * flicker + veil), "srgb")
    np.testing.assert_allclose(rate(found), rate(truth), rtol=0.05)


@pytest.mark.slow
def test_wrong_matches_weigh_little() -> None:
    truth = water_named("blue-ocean")
    clean = sightings_through(truth, reef(1500))
    rng = np.random.default_rng(4)
    wrong = rng.random(clean.patch.size) < 0.08
    light = np.where(wrong[:, None], rng.permutation(clean.light), clean.light)
    np.testing.assert_allclose(
        rate(fit_observations(replace(clean, light=light), "srgb")), rate(truth), rtol=0.1
    )


def test_what_cannot_carry_a_fit_is_refused() -> None:
    seen = sightings_through(water_named("turbid"), reef(300))
    with pytest.raises(ColorError, match="only 20 observations"):
        fit_observations(seen.part(np.arange(20)), "srgb")
    with pytest.raises(ColorError, match="fly at two altitudes"):
        fit_observations(replace(seen, range_m=np.full(seen.range_m.shape, 2.0)), "srgb")


@pytest.fixture(scope="module")
def dive() -> tuple[RectifiedPair, list[KeyFrame]]:
    """The sample dive with its true ranges."""
    rectification = Rectification.from_rig(load_rig(SAMPLES / "cam.yaml"))
    poses = read_trajectory(SAMPLES / "trajectory.tum").T_world_camera
    names = sorted(path.stem for path in (SAMPLES / "left").glob("*.png"))
    images = [
        rectification.apply_left(read_image(SAMPLES / "left" / f"{name}.png")) for name in names
    ]
    ranges = [read_range_map(SAMPLES / "truth" / "range" / f"{name}.tiff") for name in names]
    return rectification.pair, [
        KeyFrame(*parts) for parts in zip(images, ranges, poses, strict=True)
    ]


@pytest.mark.slow
def test_water_of_the_sample_dive(dive: tuple[RectifiedPair, list[KeyFrame]]) -> None:
    """Two lines at two altitudes: attenuation within 10 % of truth, with no assumption on the
    reef's colors.
    """
    geometry, frames = dive
    observations = find_observations(frames, geometry, "srgb")
    found = fit_observations(observations, "srgb")
    truth = lit_water("blue-ocean", 8.0, 8.0 - 2.15, 1.7).water
    z = np.array(np.median(observations.range_m))
    np.testing.assert_allclose(np.log(found.attenuation(z)), np.log(truth.attenuation(z)), rtol=0.1)


@pytest.mark.slow
def test_clipped_places_and_edges_are_left_out(dive: tuple[RectifiedPair, list[KeyFrame]]) -> None:
    geometry, frames = dive[0], dive[1][:4]
    usual = find_observations(frames, geometry, "srgb")
    assert np.isfinite(usual.light).all()
    assert (np.bincount(usual.patch) >= 2).all()
    blown = [replace(frame, image=np.full_like(frame.image, 255)) for frame in frames]
    assert find_observations(blown, geometry, "srgb").patch.size == 0
    unknown = [replace(frame, range_m=np.full_like(frame.range_m, np.nan)) for frame in frames]
    assert find_observations(unknown, geometry, "srgb").patch.size == 0
