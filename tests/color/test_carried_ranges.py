"""Color where no range was measured: carried over from neighbors, from behind and not from in
front, and marked.
"""

from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import SampleRun

from stereo_seecolor.color.render.carried import Smoother, carry_ranges
from stereo_seecolor.color.render.carried_colors import inside_right_image, within_measured
from stereo_seecolor.color.render.open_water import without_open_water
from stereo_seecolor.files.srgb import decode_srgb
from stereo_seecolor.records import Map
from stereo_seecolor.water.model import Water

REEF = Path(__file__).resolve().parents[2] / "data_samples" / "reef"
RNG = np.random.default_rng(3)


def coral_before_sand() -> tuple[np.ndarray, np.ndarray]:
    """A dark coral 1 m away before bright sand at 2 m, with the noise of a camera."""
    image = np.full((96, 128, 3), (200, 190, 160), np.uint8)
    range_m = np.full((96, 128), 2.0, np.float32)
    image[24:72, 40:88], range_m[24:72, 40:88] = (60, 40, 30), 1.0
    return np.clip(image + RNG.normal(0, 2, image.shape), 0, 255).astype(np.uint8), range_m


def test_a_strip_beside_a_coral_takes_the_range_of_its_own_color() -> None:
    image, true_m = coral_before_sand()
    known_m = true_m.copy()
    known_m[24:72, 32:48] = np.nan  # half on the sand, half on the coral
    found_m = carry_ranges(image, known_m)
    np.testing.assert_allclose(found_m[28:68, 34:38], 2.0, atol=0.15)
    np.testing.assert_allclose(found_m[28:68, 43:46], 1.0, atol=0.15)


def test_measured_ranges_stay_and_all_others_are_within_them() -> None:
    image, true_m = coral_before_sand()
    known_m = np.where(RNG.uniform(size=true_m.shape) < 0.3, true_m, np.float32(np.nan))
    found_m = carry_ranges(image, known_m)
    measured = np.isfinite(known_m)
    np.testing.assert_array_equal(found_m[measured], known_m[measured])
    assert np.isfinite(found_m).all()
    assert found_m.min() >= 1.0
    assert found_m.max() <= 2.0


def test_scattered_ranges_give_those_between_them() -> None:
    """A slope of one color, of which a fiftieth is measured: the range beside a pixel says more
    than those of the whole slope.
    """
    true_m = np.linspace(2.0, 4.0, 192, dtype=np.float32)[:, None] * np.ones((1, 256), np.float32)
    image = np.full((192, 256, 3), 40, np.uint8)
    known_m = np.where(RNG.uniform(size=true_m.shape) < 0.02, true_m, np.float32(np.nan))
    assert np.abs(carry_ranges(image, known_m) / true_m - 1).mean() < 0.02


def test_what_the_camera_did_not_see_and_frames_without_any_range_stay_unknown() -> None:
    image, range_m = coral_before_sand()
    range_m[:, :10] = np.nan
    seen = np.ones(range_m.shape, bool)
    seen[:, :5] = False
    found_m = carry_ranges(image, range_m, seen)
    assert np.isnan(found_m[:, :5]).all()
    assert np.isfinite(found_m[:, 5:]).all()
    nothing_m = np.full(range_m.shape, np.nan, np.float32)
    assert np.isnan(carry_ranges(image, nothing_m)).all()


def test_sixteen_bits_give_the_same_ranges_as_eight() -> None:
    image, range_m = coral_before_sand()
    range_m[30:60, 20:60] = np.nan
    np.testing.assert_array_equal(
        carry_ranges(image, range_m), carry_ranges(image.astype(np.uint16) * 257, range_m)
    )


@pytest.mark.parametrize("shape", [(2, 2), (1, 40), (40, 2), (3, 1)])
def test_pictures_narrower_than_a_step_are_filled_too(shape: tuple[int, int]) -> None:
    range_m = np.full(shape, 2.0, np.float32)
    range_m[-1, -1] = np.nan

    filled = carry_ranges(np.full((*shape, 3), 90, np.uint8), range_m)

    np.testing.assert_allclose(filled, 2.0, rtol=1e-5)


@pytest.mark.slow
def test_filled_pixels_of_the_sample_dive_are_nearly_as_true_as_measured_ones(
    sample_run: SampleRun,
) -> None:
    """Angular error to the true color, after one gain a channel, of pixels that are neither dark
    nor clipped.
    """
    measured, filled = [], []
    for path in sorted((sample_run.out / "corrected").glob("*.png")):
        mask = cv2.imread(str(sample_run.out / "mask" / path.name), cv2.IMREAD_UNCHANGED)
        assert (mask != 1).all()
        assert (cv2.imread(str(path)).max(axis=2) > 0).mean() > 0.999
        error_deg, usable = angular_error(path)
        measured.append(error_deg[usable & (mask == 0)])
        filled.append(error_deg[usable & (mask == 2)])
    assert np.concatenate(filled).size > 10_000
    assert np.mean(np.concatenate(filled)) <= 1.1 * np.mean(np.concatenate(measured))
    # red sponges and blue corals too, which end at no seam
    assert np.quantile(np.concatenate(filled), 0.99) <= np.quantile(np.concatenate(measured), 0.99)


@pytest.mark.slow
def test_range_maps_and_clouds_hold_measured_pixels_alone(sample_run: SampleRun) -> None:
    for path in sorted((sample_run.out / "range").glob("*.tiff"))[:3]:
        known = np.isfinite(cv2.imread(str(path), cv2.IMREAD_UNCHANGED))
        mask = cv2.imread(str(sample_run.out / "mask" / f"{path.stem}.png"), cv2.IMREAD_UNCHANGED)
        np.testing.assert_array_equal(mask == 2, ~known)
        header = (sample_run.out / "clouds" / f"{path.stem}.ply").read_bytes()[:600]
        assert f"element vertex {known.sum()}".encode() in header


def angular_error(path: Path) -> tuple[np.ndarray, np.ndarray]:
    found = linear(cv2.imread(str(path))[..., ::-1])
    true = linear(cv2.imread(str(REEF / "truth" / "color" / path.name))[..., ::-1])
    usable = (true.max(axis=2) < 0.98) & (true.min(axis=2) > 0.005) & (found.max(axis=2) < 0.98)
    cosine = (found * true).sum(axis=2) / np.maximum(
        np.linalg.norm(found, axis=2) * np.linalg.norm(true, axis=2), 1e-9
    )
    return np.degrees(np.arccos(np.clip(cosine, -1, 1))), usable


def linear(srgb: np.ndarray) -> np.ndarray:
    return (srgb / 255.0) ** 2.2


def test_a_few_wrong_matches_far_away_are_not_carried() -> None:
    image, true_m = (
        cv2.resize(part, None, fx=4, fy=4, interpolation=cv2.INTER_NEAREST)
        for part in coral_before_sand()
    )
    known_m = true_m.copy()
    known_m[:96] = np.nan
    # the nearest to what is to be carried, and weighed by the square of its range
    known_m[88:96, 200:220] = 9.0
    found_m = carry_ranges(image, known_m)
    assert carry_ranges(image, known_m, smoother=Smoother(strays=0.0))[60:86, 205:215].mean() > 4
    np.testing.assert_allclose(found_m[60:86, 205:215], 2.0, atol=0.1)


@pytest.mark.parametrize(
    ("dtype", "full"), [(np.uint8, 255), (np.uint16, 65535), (np.float32, 1.0)]
)
def test_what_lies_at_carried_ranges_is_no_redder_than_the_measured_reef(
    dtype: type, full: float
) -> None:
    # within 1.7 and 2.1 times as red
    colors = np.array([0.5, 0.4, 0.3]) * RNG.uniform(0.9, 1.1, (96, 128, 3))
    carried = np.zeros((96, 128), bool)
    carried[:, 100:] = True
    colors[:40, 100:] = (0.6, 0.1, 0.1)  # a rim before open water
    colors[60:, 100:] = (0.5, 0.42, 0.05)  # a yellow sponge: 10 times as red as blue
    image = (colors * full).astype(dtype)
    held = within_measured(image, carried, ~carried)
    np.testing.assert_array_equal(held[~carried], image[~carried])
    np.testing.assert_array_equal(held[:40, 100:, 1:], image[:40, 100:, 1:])
    assert held[:40, 100:, 0].max() < 0.25 * full
    # what is as red as the reef stays
    assert (held[40:60, 100:] == image[40:60, 100:]).all(axis=-1).mean() > 0.8
    np.testing.assert_array_equal(held[60:], image[60:])
    # nothing measured, nothing known
    np.testing.assert_array_equal(within_measured(image, carried, np.zeros_like(carried)), image)
    no_carried = np.zeros_like(carried)
    assert within_measured(image, no_carried, ~carried) is image


@pytest.mark.parametrize(
    "water", [(0.1, 0.5, 0.5), (0.2, 0.3, 0.8), (0.4, 0.4, 0.8), (0.3, 0.7, 0.3)]
)
def test_open_water_is_hardly_more_colored_than_the_measured_reef(
    water: tuple[float, float, float],
) -> None:
    """Cyan, blue, violet, green: of no range at all, what water scatters would be shown as a
    surface of its color.
    """
    colors = np.array([0.45, 0.4, 0.35]) * RNG.uniform(0.9, 1.1, (160, 160, 3))
    carried = np.zeros((160, 160), bool)
    carried[:80] = True
    colors[:80] = water
    held = within_measured(np.round(colors * 255).astype(np.uint8), carried, ~carried)[0, 0].astype(
        float
    )
    reef = colors[80:].reshape(-1, 3)
    assert max(water) / min(water) > 1.9
    assert held.max() / held.min() < (reef.max(axis=1) / reef.min(axis=1)).max()


@pytest.mark.parametrize("water", [(0.5, 0.35, 0.5), (0.3, 0.2, 0.4), (0.4, 0.3, 0.32)])
def test_open_water_is_not_violet_or_pink(water: tuple[float, float, float]) -> None:
    """Even where some of the measured reef is, and the rest brown."""
    colors = np.array([0.45, 0.4, 0.35]) * RNG.uniform(0.9, 1.1, (160, 160, 1))
    colors[80:, :40] = (0.4, 0.2, 0.45)  # a quarter is violet
    carried = np.zeros((160, 160), bool)
    carried[:80] = True
    colors[:80] = water
    red, green, blue = within_measured(np.round(colors * 255).astype(np.uint8), carried, ~carried)[
        0, 0
    ].astype(int)
    assert green >= min(red, blue) - 1  # of 255


def test_a_hole_in_a_rare_color_keeps_it() -> None:
    """A red sponge in a brown reef, with holes in its ranges as matching leaves them."""
    colors = np.array([0.45, 0.4, 0.35]) * RNG.uniform(0.9, 1.1, (160, 160, 1))
    colors[60:90, 60:90] = (0.6, 0.15, 0.15)
    image = np.round(colors * 255).astype(np.uint8)
    carried = np.zeros((160, 160), bool)
    carried[70:80, 70:80] = True
    assert (within_measured(image, carried, ~carried) == image).all()
    carried[65:85, 65:85] = True
    # a wide area is limited
    assert (within_measured(image, carried, ~carried)[75, 75] < image[75, 75]).any()


def test_the_strip_that_the_right_camera_does_not_see_is_not_taken_for_open_water() -> None:
    carried, outside = np.zeros((2, 120, 160), bool)
    outside[:, :30] = True
    carried[:, :33] = True  # matching needs a few pixels more
    carried[40:80, 90:140] = True  # a cave
    cave = carried.copy()
    cave[:, :33] = False
    np.testing.assert_array_equal(inside_right_image(carried, outside), cave)
    carried[:50] = True  # open water, which the strip reaches into
    np.testing.assert_array_equal(inside_right_image(carried, outside), carried)
    np.testing.assert_array_equal(inside_right_image(carried, np.zeros_like(outside)), carried)


def test_white_at_a_carried_range_stays_at_full_scale() -> None:
    """Where all that is measured is redder than white, red cannot be raised any more."""
    image = np.round(np.array([0.5, 0.45, 0.4]) * RNG.uniform(0.9, 1.1, (96, 128, 1)) * 255).astype(
        np.uint8
    )
    carried = np.zeros((96, 128), bool)
    carried[:8, :8] = True
    image[carried] = 255
    np.testing.assert_array_equal(within_measured(image, carried, ~carried)[carried][:, 0], 255)


# Rims before open water


REEF_EDGE, RANGE_EDGE = 120, 108
VEIL = (30.0, 90.0, 160.0)
BLUE = Water(
    decode_srgb(np.array(VEIL) / 255),
    np.full(3, 0.2),
    *np.zeros((4, 3)),
    y=np.array([0.5, 0.1, 0.07]),
    x=np.zeros(3),
)


def reef_before(behind: tuple[float, float, float], contrast: float) -> tuple[np.ndarray, Map]:
    """A reef of which ranges reach 12 px too far into what lies behind it, which is of one color
    with some texture.
    """
    texture = RNG.normal(0, 1, (40, 50)).repeat(4, axis=0).repeat(4, axis=1)[..., None]
    image = np.array([70.0, 110, 90]) * (1 + 0.2 * texture)
    image[:, :REEF_EDGE] = np.array(behind) * (1 + contrast * texture[:, :REEF_EDGE])
    image += RNG.normal(0, 1.5, image.shape)
    range_m = np.full(image.shape[:2], 3.0, np.float32)
    range_m[:, :RANGE_EDGE] = np.nan
    return np.clip(image, 0, 255).astype(np.uint8), range_m


@pytest.mark.parametrize("depth", [np.uint8, np.uint16])
def test_ranges_that_reach_into_open_water_are_left_out_and_the_reef_keeps_its_own(
    depth: type,
) -> None:
    image, range_m = reef_before(VEIL, 0.01)
    given = image if depth is np.uint8 else image.astype(np.uint16) * 257
    kept = np.isfinite(without_open_water(given, range_m, BLUE))
    assert kept[:, RANGE_EDGE:REEF_EDGE].mean() < 0.05
    assert kept[:, REEF_EDGE:].mean() > 0.99
    shown_m = carry_ranges(given, without_open_water(given, range_m, BLUE))
    assert np.isfinite(shown_m).all()


@pytest.mark.parametrize(
    ("behind", "contrast"),
    [((140, 120, 90), 0.15), ((90, 130, 160), 0.01), ((12, 14, 13), 0.12)],
    ids=["rubble", "even sand", "shadow"],
)
def test_ranges_beside_what_matching_did_not_know_stay(
    behind: tuple[float, float, float], contrast: float
) -> None:
    image, range_m = reef_before(behind, contrast)
    assert without_open_water(image, range_m, BLUE) is range_m


def test_what_the_camera_did_not_see_is_no_open_water() -> None:
    image, range_m = reef_before((0, 0, 0), 0)
    seen = np.ones(range_m.shape, bool)
    seen[:, :REEF_EDGE] = False
    assert without_open_water(image, range_m, BLUE, seen) is range_m
    nothing_m = np.full_like(range_m, np.nan)
    assert without_open_water(image, nothing_m, BLUE) is nothing_m
