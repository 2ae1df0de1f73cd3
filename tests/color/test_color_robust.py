import itertools
import runpy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from stereo_seecolor.color.corrector import Corrector
from stereo_seecolor.color.fitting import robust
from stereo_seecolor.color.fitting.robust_solver import NOISE, minimize
from stereo_seecolor.color.fitting.scene_colors import sea_floor
from stereo_seecolor.color.fitting.scene_prior import whole_prior
from stereo_seecolor.color.fitting.water_prior import (
    LARGEST_LOG_NEAR,
    RATE_OF_CHANGE,
    WATER,
    random_camera,
    water_prior,
)
from stereo_seecolor.color.table.counting import measure
from stereo_seecolor.color.table.moment_table import MomentTable
from stereo_seecolor.color.table.range_quantiles import (
    FRACTIONS,
    RangeQuantiles,
    quantiles_by_range,
)
from stereo_seecolor.config import ColorConfig, RobustConfig
from stereo_seecolor.extras.evaluation.measures import score_truth
from stereo_seecolor.files.srgb import decode_srgb, encode_srgb
from stereo_seecolor.records import Water
from stereo_seecolor.water.physics import optical_depth

SHAPE = (160, 240)
CONFIG = ColorConfig()
SPECTRA = runpy.run_path(str(Path(__file__).resolve().parents[2] / "benchmarks/spectra.py"))


def some_water(
    gamma_inf: list[float], beta: list[float], far: list[float], white: list[float]
) -> Water:
    zero, change = np.zeros(3), np.full(3, RATE_OF_CHANGE)
    veil = {
        "gamma_inf": np.array(gamma_inf),
        "beta": np.array(beta),
        "eta": zero,
        "alpha": np.ones(3),
    }
    return Water(**veil, w=zero, v=change, y=np.array(far), x=zero, white=np.array(white))


BLUE = some_water(
    [0.02, 0.10, 0.16], [0.4, 0.12, 0.1], far=[0.4, 0.1, 0.07], white=[0.35, 0.9, 1.0]
)
GREEN = some_water(
    [0.08, 0.2, 0.15], [0.45, 0.3, 0.35], far=[0.45, 0.3, 0.35], white=[0.5, 0.9, 0.6]
)


def reef(rng: np.random.Generator, cast: tuple[float, float, float] = (1, 1, 1)) -> np.ndarray:
    """(H, W, 3) linear colors of a reef of sand, rock and coral in shade and sun, in blocks of 8
    pixels.
    """
    materials = np.array(
        [
            [0.5, 0.43, 0.33],
            [0.25, 0.23, 0.2],
            [0.25, 0.17, 0.09],
            [0.45, 0.1, 0.06],
            [0.12, 0.2, 0.07],
        ]
    )
    blocks = rng.choice(
        len(materials), (SHAPE[0] // 8, SHAPE[1] // 8), p=[0.35, 0.3, 0.15, 0.1, 0.1]
    )
    light = np.exp(0.4 * rng.standard_normal((*SHAPE, 1))).clip(0.02, 1.9)
    return np.clip(np.kron(materials[blocks], np.ones((8, 8, 1))) * light * cast, 0, 1)


def test_the_fitted_attenuation_is_monotonic_in_range() -> None:
    """At the largest near over far that the fit takes, and no more beyond it."""
    z = np.linspace(0.1, 40, 400)
    for log_near, falls in ((LARGEST_LOG_NEAR, True), (LARGEST_LOG_NEAR + 0.1, False)):
        depth = optical_depth(z, 0.2 * np.expm1(log_near), RATE_OF_CHANGE, 0.2, 0.0)
        assert bool((np.diff(depth) >= -1e-12).all()) == falls


def slope(near_m: float = 1.0, far_m: float = 4.0) -> np.ndarray:
    return np.broadcast_to(
        np.linspace(near_m, far_m, SHAPE[0], dtype=np.float32)[:, None], SHAPE
    ).copy()


def seen_through(
    water: Water,
    truth: np.ndarray,
    range_m: np.ndarray,
    rng: np.random.Generator,
    exposure: float = 1.0,
) -> np.ndarray:
    light = exposure * (
        truth * water.white * water.attenuation(range_m) + water.backscatter(range_m)
    )
    noisy = encode_srgb(light) + 0.004 * rng.standard_normal(light.shape)
    return np.round(np.clip(noisy, 0, 1) * 255).astype(np.uint8)


def errors_deg(
    image: np.ndarray, truth: np.ndarray, range_m: np.ndarray, water: Water
) -> tuple[float, float]:
    light = np.maximum(decode_srgb(image / 255) - water.backscatter(range_m), 0) / (
        water.attenuation(range_m) * water.white
    )
    score = score_truth(encode_srgb(light), encode_srgb(truth))
    return score.angle_deg, score.angle_after_gains_deg


def test_light_that_would_grow_with_range_is_not_fitted() -> None:
    """Even where the prior asks for it."""
    rng, range_m = np.random.default_rng(2), slope()
    seen = quantiles_by_range(
        measure(seen_through(BLUE, reef(rng), range_m, rng), range_m), CONFIG.input_encoding
    )
    problem, start = robust._begin(seen, CONFIG.robust)
    mean, precision = problem.mean.copy(), problem.precision.copy()
    mean[3:6] = LARGEST_LOG_NEAR + 2
    precision[3:6, 3:6] += 1e6 * np.eye(3)
    (found,), _, _ = minimize([problem._replace(mean=mean, precision=precision)], [start])
    assert found[3:6] == pytest.approx(LARGEST_LOG_NEAR)


def test_green_loses_no_more_against_blue_than_in_any_sea() -> None:
    """What lies far is bluer: without what is known of seawater, the fit says that green loses 0.2
    / m more than blue.
    """
    rng, range_m = np.random.default_rng(6), slope(1.0, 6.0)
    shade = np.exp(-np.outer(range_m.ravel() - 1, [0.3, 0.2, 0.0])).reshape(*SHAPE, 3)
    water = Corrector(CONFIG).fit_frame(
        seen_through(BLUE, reef(rng) * shade, range_m, rng), range_m
    )
    for coefficients in (water.y, water.y + water.w):
        assert coefficients[1] - coefficients[2] < 0.1


@pytest.mark.slow
@pytest.mark.parametrize(("particles", "warned"), [(0.0, False), (0.02, True)])
def test_lamp_lit_particles_are_named_where_they_are_taken_for_white(
    particles: float, warned: bool
) -> None:
    """They are redder than anything that daylight reaches: the white point then lacks red, and
    colors come out green.
    """
    rng, range_m = np.random.default_rng(4), slope()
    image = seen_through(BLUE, reef(rng), range_m, rng)
    image[rng.random(SHAPE) < particles] = (230, 235, 235)
    warnings = Corrector(CONFIG).fit_frame(image, range_m).warnings
    assert warnings == ((robust.RED_HIGHLIGHTS,) if warned else ())


@pytest.mark.parametrize("water", [BLUE, GREEN])
def test_known_water_is_taken_out(water: Water) -> None:
    rng = np.random.default_rng(11)
    truth, range_m = reef(rng), slope()
    image = seen_through(water, truth, range_m, rng)
    found = robust.fit(measure(image, range_m), CONFIG)
    angle, after_gains = errors_deg(image, truth, range_m, found)
    floor, _ = errors_deg(image, truth, range_m, water)
    assert angle < floor + 2.5
    assert after_gains < floor + 1.0
    assert found.warnings == ()
    truly, fitted = water.attenuation(np.array([1.5, 3.5])), found.attenuation(np.array([1.5, 3.5]))
    # what the colors of an image tell is how much faster red goes than green, and green than blue
    np.testing.assert_allclose(
        np.diff(np.log(fitted[1] / fitted[0])), np.diff(np.log(truly[1] / truly[0])), atol=0.15
    )


@pytest.mark.slow
def test_true_attenuation_lies_within_a_few_standard_errors() -> None:
    rng = np.random.default_rng(3)
    range_m = slope()
    off = []
    for _ in range(6):
        found = robust.fit(measure(seen_through(BLUE, reef(rng), range_m, rng), range_m), CONFIG)
        off.append((found.y - BLUE.y) / found.standard_errors["y"])
    assert np.abs(np.median(off, axis=0)).max() < 3
    assert np.isfinite(off).all()


def test_without_relief_a_fit_knows_less_and_says_so() -> None:
    rng = np.random.default_rng(4)
    range_m = np.full(SHAPE, 2.0, np.float32)
    image = seen_through(BLUE, reef(rng), range_m, rng)
    found = robust.fit(measure(image, range_m), CONFIG)
    relief = robust.fit(measure(seen_through(BLUE, reef(rng), slope(), rng), slope()), CONFIG)
    assert len(found.warnings) == 1
    assert found.warnings[0].startswith("little relief, 2.0")
    assert relief.warnings == ()
    assert (found.standard_errors["y"] / found.y > relief.standard_errors["y"] / relief.y).all()


def test_a_blown_frame_leaves_the_prior() -> None:
    blown = robust.fit(measure(np.full((*SHAPE, 3), 255, np.uint8), slope()), CONFIG)
    assert blown.warnings[0].startswith("every pixel is at full scale")
    assert np.isnan(blown.standard_errors["y"]).all()
    np.testing.assert_allclose(np.log(blown.y), water_prior()[0][:3], atol=0.05)


def test_a_start_changes_nothing_but_time() -> None:
    rng = np.random.default_rng(5)
    range_m = slope()
    table = measure(seen_through(GREEN, reef(rng), range_m, rng), range_m)
    cold = robust.fit(table, CONFIG)
    other = robust.fit(measure(seen_through(BLUE, reef(rng), range_m, rng), range_m), CONFIG)
    warm = robust.fit(table, CONFIG, other)
    z = np.linspace(1, 4, 7)
    np.testing.assert_allclose(warm.attenuation(z), cold.attenuation(z), rtol=0.03)
    np.testing.assert_allclose(warm.white / warm.white[1], cold.white / cold.white[1], rtol=0.03)
    # a water of the paper's fit is not of this form, and no start
    papers = replace(cold, v=np.full(3, 0.4))
    np.testing.assert_array_equal(robust.fit(table, CONFIG, papers).y, cold.y)


def test_exposure_moves_only_the_level() -> None:
    rng = np.random.default_rng(6)
    truth, range_m = reef(rng), slope()
    bright, dark = (
        robust.fit(
            measure(
                seen_through(BLUE, truth, range_m, np.random.default_rng(1), exposure), range_m
            ),
            CONFIG,
        )
        for exposure in (0.9, 0.3)
    )
    np.testing.assert_allclose(dark.white / dark.white[1], bright.white / bright.white[1], rtol=0.1)
    np.testing.assert_allclose((dark.white / bright.white)[1], 1 / 3, rtol=0.1)


@pytest.mark.slow
def test_a_surveys_sum_is_fitted_like_a_frame() -> None:
    rng = np.random.default_rng(8)
    total = MomentTable.empty()
    truths, images, ranges = [], [], []
    for altitude in (1.0, 1.6, 2.4, 3.2):
        truths.append(reef(rng))
        ranges.append(slope(altitude, 1.1 * altitude))
        images.append(seen_through(BLUE, truths[-1], ranges[-1], rng))
        total = total + measure(images[-1], ranges[-1])
    found = robust.fit(total, CONFIG)
    for image, truth, range_m in zip(images, truths, ranges, strict=True):
        assert (
            errors_deg(image, truth, range_m, found)[0]
            < errors_deg(image, truth, range_m, BLUE)[0] + 2.5
        )


def test_sixteen_bits_see_what_eight_see() -> None:
    rng = np.random.default_rng(9)
    range_m = slope()
    image = seen_through(BLUE, reef(rng), range_m, rng)
    eight = robust.fit(measure(image, range_m), CONFIG)
    sixteen = robust.fit(measure(image.astype(np.uint16) * 257, range_m), CONFIG)
    np.testing.assert_allclose(
        sixteen.attenuation(np.array([2.0])), eight.attenuation(np.array([2.0])), rtol=0.05
    )


def test_quantiles_are_those_of_the_pixels() -> None:
    rng = np.random.default_rng(10)
    image = rng.integers(20, 240, (*SHAPE, 3)).astype(np.uint8)
    seen = quantiles_by_range(measure(image, np.full(SHAPE, 1.5, np.float32)), "as-is")
    assert seen.range_m == pytest.approx([1.5], abs=0.02)
    expected = np.quantile(image.reshape(-1, 3) / 255, FRACTIONS, axis=0).T
    np.testing.assert_allclose(seen.light[:, 0], expected, atol=1 / 255)


def test_few_far_pixels_are_of_a_range_of_their_own() -> None:
    range_m = slope(1.0, 1.5)
    range_m[:3] = 6.0
    image = np.full((*SHAPE, 3), 90, np.uint8)
    image[:3] = 200
    seen = quantiles_by_range(measure(image, range_m), "as-is")
    assert seen.range_m[-2:] == pytest.approx([1.5, 6.0], rel=0.05)
    assert seen.light[:, -1].min() == pytest.approx(200 / 255, abs=0.01)
    assert seen.light[:, :-1].max() == pytest.approx(90 / 255, abs=0.01)
    assert seen.pixels.sum() == range_m.size


@pytest.mark.slow
@settings(max_examples=25)
@given(
    st.integers(0, 2**31),
    st.sampled_from([(1, 1), (2, 2), (9, 7)]),
    st.sampled_from([np.uint8, np.uint16]),
    st.floats(0.05, 40),
)
def test_any_image_gives_a_finite_water(
    seed: int, shape: tuple[int, int], dtype: type, far_m: float
) -> None:
    rng = np.random.default_rng(seed)
    top = np.iinfo(dtype).max
    image = rng.choice([0, 1, top // 3, top], (*shape, 3)).astype(dtype)
    range_m = (rng.random(shape) * far_m + 0.01).astype(np.float32)
    found = robust.fit(measure(image, range_m), CONFIG)
    z = np.array([0.2, 2.0, 10.0])
    for value in (found.backscatter(z), found.attenuation(z), found.white):
        assert np.isfinite(value).all()
    assert (found.attenuation(z) > 0).all()
    assert (np.diff(found.attenuation(z), axis=0) <= 0).all()


def test_known_depth_narrows_the_white_point() -> None:
    _, anywhere = water_prior()
    at_surface, there = water_prior(0.0)
    level = np.eye(3) - 1 / 3
    # no water above: daylight as it is
    np.testing.assert_allclose(level @ at_surface[12:], 0, atol=1e-9)
    assert np.trace(level @ there[12:, 12:] @ level) < np.trace(level @ anywhere[12:, 12:] @ level)
    deep, _ = water_prior(10.0)
    assert deep[12] < at_surface[12] - 0.3  # red is lost first


def test_no_scene_tells_the_white_point_better_than_its_own_cast() -> None:
    prior = np.array([[0.2, 0.05, 0.0], [0.05, 0.1, 0.02], [0.0, 0.02, 0.15]])
    of_color, cast = np.eye(3) - 1 / 3, sea_floor().cast
    level = np.ones((3, 3))  # an exposure of any size is no color

    def errors_of(covariance):
        return np.sqrt(np.diag(of_color @ covariance @ of_color))

    exact = robust.error_with_cast(1e-9 * np.eye(3), prior + level)
    both = np.linalg.inv(np.linalg.inv(prior + 1e6 * level) + np.linalg.inv(cast + 1e6 * level))
    np.testing.assert_allclose(exact, errors_of(both), rtol=1e-3)
    # hardly anything learned
    unchanged = robust.error_with_cast(0.999 * prior, prior)
    np.testing.assert_allclose(unchanged, errors_of(prior), rtol=2e-3)
    set_by_user = ColorConfig(robust=RobustConfig(white_point=(0.9, 1.0, 0.8)))
    rng = np.random.default_rng(3)
    table = measure(seen_through(BLUE, reef(rng), slope(), rng), slope())
    errors = [
        robust.fit(table, config).standard_errors["white"] for config in (CONFIG, set_by_user)
    ]
    assert (errors[0] > 0.06).all() and not (errors[1] > 0.01).any()


def test_published_spectra_have_the_colors_that_are_known() -> None:
    kinds, _, spectra = SPECTRA["read_spectra"]()
    assert ((spectra > 0) & (spectra < 1)).all()
    red, green, blue = np.log(spectra @ random_camera(np.full(4, 0.5)).T).T
    sand = np.array(kinds) == "sand"
    assert ((red - green)[sand] > np.log(1.1)).all() and ((red - green)[sand] < np.log(1.2)).all()
    assert ((blue - green)[sand] > np.log(0.7)).all() and (
        (blue - green)[sand] < np.log(0.85)
    ).all()
    for kind, channels in {
        "green algae": green - red,
        "brown algae": red - green,
        "blue coral": blue - green,
    }.items():
        assert channels[np.array(kinds) == kind].mean() > 0.02, kind


def test_magenta_costs_more_than_brown() -> None:
    """A scene all of whose colors are off from warm to cool is likelier than one that is as far off
    toward magenta.
    """
    precision = whole_prior(5, CONFIG.robust)[1]
    content = precision[WATER:-5, WATER:-5]
    warm, magenta = (
        np.repeat(np.array(axis) / np.linalg.norm(axis), len(FRACTIONS))
        for axis in ([1.0, 0.0, -1.0], [1.0, -2.0, 1.0])
    )
    assert magenta @ content @ magenta > 3 * (warm @ content @ warm)


@pytest.mark.slow
def test_kept_colors_of_the_sea_floor_are_those_of_the_spectra() -> None:
    kept, made = sea_floor(), SPECTRA["mixed"]()
    for name in ("mean", "channels", "cast"):
        np.testing.assert_allclose(getattr(kept, name), getattr(made, name), atol=2e-4)


@pytest.mark.slow
@pytest.mark.real_data
def test_real_frames_have_no_bands_of_color(real_data: Path) -> None:
    import cv2

    for path in sorted((real_data / "flsea" / "rgb").glob("*.tiff")):
        image = cv2.imread(str(path))[..., ::-1].copy()
        range_m = cv2.imread(
            str(real_data / "flsea" / "range" / f"{path.stem}.tif"), cv2.IMREAD_UNCHANGED
        )
        corrector = Corrector(CONFIG)
        table = corrector.measure(image, range_m)
        light = corrector.apply_linear(image, range_m, corrector.fit(table))
        known = range_m > 0
        edges = np.quantile(range_m[known], np.linspace(0, 1, 13))
        means = np.stack(
            [
                light[known & (range_m >= a) & (range_m <= b)].mean(axis=0)
                for a, b in itertools.pairwise(edges)
            ]
        )
        cast = np.log(means[:, [0, 2]] / means[:, 1:2])
        assert np.abs(cast - np.median(cast, axis=0)).max() < 0.45, path.stem


def drawn_from_the_prior(
    rng: np.random.Generator, range_m: NDArray[np.float64]
) -> tuple[RangeQuantiles, NDArray[np.float64]]:
    """Quantiles of a scene, all of which has a cast, and a water that are as likely as the fit
    takes them to be, and the water's logarithms, (5, 3). The quantiles of a range err together.
    """
    mean, precision, _ = whole_prior(range_m.size, CONFIG.robust)
    while True:
        x = rng.multivariate_normal(mean, np.linalg.inv(precision))
        far, near, beta, backscatter, white = np.exp(x[:WATER].reshape(5, 3, 1))
        # others are no water to the fit
        if max(far[1] - far[2], (far * near)[1] - (far * near)[2]) < NOISE.green_over_blue:
            break
    loss = range_m * far * (1 + (near - 1) * np.exp(-RATE_OF_CHANGE * range_m))
    reflectance, brightness = x[WATER : -range_m.size].reshape(3, 1, -1), x[-range_m.size :, None]
    cast = rng.multivariate_normal(np.zeros(3), sea_floor().cast, check_valid="ignore").reshape(
        3, 1, 1
    )
    direct = np.exp(reflectance + cast + brightness) * (white * np.exp(-loss))[..., None]
    veil = np.broadcast_to(
        (backscatter * white * -np.expm1(-beta * range_m))[..., None], direct.shape
    )
    spread = np.hypot(NOISE.content * direct / (direct + veil), NOISE.all)
    # of a range, dark to bright
    light = (direct + veil) * np.exp(spread * rng.standard_normal((3, range_m.size, 1)))
    return RangeQuantiles(
        range_m, np.full(range_m.size, 1e5), light, np.zeros(light.shape, np.bool_)
    ), x[:WATER].reshape(5, 3)


@pytest.mark.slow
def test_standard_errors_are_marginal() -> None:
    """Over waters and scenes drawn from the prior, errors against their standard errors have a
    spread of one.
    """
    rng, range_m = np.random.default_rng(5), np.geomspace(1.0, 5.0, 12)
    drawn = [drawn_from_the_prior(rng, range_m) for _ in range(150)]
    fitted, _ = robust.fit_all([seen for seen, _ in drawn], CONFIG)
    names = ("y", "w", "beta", "gamma_inf", "white")
    off: dict[str, list[NDArray[np.float64]]] = {name: [] for name in names}
    for found, (_, (far, near, beta, backscatter, white)) in zip(fitted, drawn, strict=True):
        level = np.exp(np.mean(np.log(found.white) - white))
        truth = {"y": np.exp(far), "w": np.exp(far) * np.expm1(near), "beta": np.exp(beta)}
        truth |= {"gamma_inf": np.exp(backscatter + white), "white": np.exp(white) * level}
        for name, error in found.standard_errors.items():
            off[name].append((getattr(found, name) - truth[name]) / error)
    for name, ratios in off.items():
        middle = np.nanquantile(np.array(ratios), [0.16, 0.84])
        assert 0.75 < np.ptp(middle) / 2 < 1.3, name
