import numpy as np
import pytest

from stereo_seecolor.extras.evaluation import baselines
from stereo_seecolor.extras.evaluation.measures import angle_deg

SHAPE = (60, 80)


@pytest.fixture
def scene() -> tuple[np.ndarray, np.ndarray]:
    """(truth, range_m): gray on average, with black in it at every range."""
    rng = np.random.default_rng(8)
    truth = rng.uniform(0, 0.7, (*SHAPE, 1)) * (1 + 0.3 * rng.uniform(-1, 1, (*SHAPE, 3)))
    truth[rng.random(SHAPE) < 0.05] = 0
    return truth, np.broadcast_to(np.linspace(1, 5, SHAPE[0])[:, None], SHAPE).copy()


def through(
    truth: np.ndarray, z: np.ndarray, rate: np.ndarray, veil: np.ndarray, white: np.ndarray
) -> np.ndarray:
    gone = np.exp(-rate * z[..., None])
    return truth * white * gone + veil * (1 - gone)


def angle(result: np.ndarray, truth: np.ndarray) -> float:
    lit = truth.max(axis=-1) > 0.1
    return float(np.nanmean(angle_deg(result[lit], truth[lit])))


RATE, VEIL, WHITE = (
    np.array([0.4, 0.15, 0.1]),
    np.array([0.05, 0.15, 0.2]),
    np.array([0.4, 0.9, 1.0]),
)


def test_simple_model_undoes_its_own_water(scene: tuple[np.ndarray, np.ndarray]) -> None:
    truth, z = scene
    image = through(truth, z, RATE, VEIL, WHITE)
    assert angle(baselines.simple_model(image, z), truth) < 2.0 < angle(image, truth) / 4


@pytest.mark.slow
def test_sea_thru_undoes_water_with_a_white_point(scene: tuple[np.ndarray, np.ndarray]) -> None:
    truth, z = scene
    image = through(truth, z, RATE, VEIL, WHITE)
    assert angle(baselines.sea_thru(image, z), truth) < angle(baselines.gray_world(image, z), truth)
    assert angle(baselines.sea_thru(image, z), truth) < 5


def test_gray_world_undoes_a_gain_a_channel(scene: tuple[np.ndarray, np.ndarray]) -> None:
    truth, z = scene
    assert angle(baselines.gray_world(truth * WHITE, z), truth) < 0.5


def test_contrast_stretch_uses_the_whole_scale_and_clips_what_it_is_made_to(
    scene: tuple[np.ndarray, np.ndarray],
) -> None:
    truth, z = scene
    result = baselines.contrast_stretch(0.2 + 0.3 * truth, z)
    assert result.min() == 0
    assert result.max() == 1
    assert np.mean(result >= 1, axis=(0, 1)) == pytest.approx(0.01, abs=0.003)


def test_the_darkest_of_each_range_are_found() -> None:
    z = np.linspace(1, 3, 5000)
    pixels = 0.5 + 0.1 * z[:, None] * np.ones(3)
    pixels[::100] = 0.1 * z[::100, None]
    range_m, colors = baselines.darkest(pixels, z)
    np.testing.assert_allclose(colors, 0.1 * range_m[:, None] * np.ones(3))
    assert len(range_m) == 50


def test_local_space_average_keeps_to_its_own_range() -> None:
    z = np.full(SHAPE, 1.0)
    z[:, 40:] = 5.0
    direct = np.where(z[..., None] == 1.0, [0.4, 0.2, 0.1], [0.05, 0.2, 0.3])
    average = baselines.local_space_average(direct, z)
    np.testing.assert_allclose(
        average[:, 5:35].mean(axis=(0, 1)), 2 * np.array([0.4, 0.2, 0.1]), rtol=0.02
    )
    np.testing.assert_allclose(
        average[:, 45:75].mean(axis=(0, 1)), 2 * np.array([0.05, 0.2, 0.3]), rtol=0.02
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", list(baselines.METHODS))
def test_unknown_ranges_and_a_single_range_are_survived(
    name: str, scene: tuple[np.ndarray, np.ndarray]
) -> None:
    truth, z = scene
    z[:20] = np.nan
    result = baselines.METHODS[name](truth * WHITE, z)
    assert np.isfinite(result[20:]).all()
    flat = baselines.METHODS[name](truth * WHITE, np.full(SHAPE, 2.0))
    assert np.isfinite(flat).all()
