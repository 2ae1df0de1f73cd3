"""Lengths and areas on the surface that a frame shows: closed forms, silhouettes, and the synthetic
reef's known truth.
"""

import csv
import io
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import Cli, CopyRun

from calibration import RectifiedPair
from stereo_seecolor.commands.run import range_maps
from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.reef.ground_volume import volume_above
from stereo_seecolor.extras.reef.lengths_and_areas import (
    along_surface,
    length_along,
    planar_area,
    range_of,
    straight_length,
    surface_area,
)
from stereo_seecolor.extras.reef.map_ground import Ground, Spot
from stereo_seecolor.extras.reef.measure import Wanted, measure, measured, read_wanted, surface_of
from stereo_seecolor.extras.reef.measure_limits import LIMITS
from stereo_seecolor.extras.reef.picking import FrameSurface, Pick
from stereo_seecolor.mapping.raster.grid import Grid
from stereo_seecolor.mapping.raster.height_errors import (
    HOLE_CELLS,
    OF_RELIEF,
    OF_ROUGHNESS,
    PLACE_CELLS,
)
from stereo_seecolor.mapping.raster.noise import spread_of
from stereo_seecolor.report.range_code import std_blocks
from stereo_seecolor.run_folder.finished_run import FinishedRun, open_run

GEOMETRY = RectifiedPair(400.0, 160.0, 160.0, 120.0, 0.1, (320, 240))
REEF = Path(__file__).resolve().parents[3] / "data_samples/reef"


def plane(slope: float = 0.0, depth_m: float = 2.0, std_m: float = 1e-4) -> FrameSurface:
    """z = depth + slope x, seen by the camera."""
    x = (np.arange(320) - 160.0) / 400.0
    range_m = (depth_m / (1 - slope * x))[None, :] * GEOMETRY.ray_length
    return FrameSurface(
        GEOMETRY, range_m.astype(np.float32), std_blocks(np.full((240, 320), std_m, np.float32))
    )


def picked(surface: FrameSurface, *places: tuple[float, float]) -> list[Pick]:
    found = [surface.pick(*place) for place in places]
    assert None not in found
    return [pick for pick in found if pick is not None]


# Closed forms


def test_a_point_of_a_plane_is_where_it_is_between_the_pixels_too() -> None:
    (pick,) = picked(plane(slope=0.7), (201.3, 77.9))
    x, y = 41.3 / 400, -42.1 / 400
    z = 2 / (1 - 0.7 * x)
    np.testing.assert_allclose(pick.point_m, [x * z, y * z, z], rtol=1e-5)
    assert range_of(pick).value == pytest.approx(z * np.sqrt(1 + x**2 + y**2), rel=1e-5)


def test_length_and_area_on_a_slanted_plane() -> None:
    surface = plane(slope=1.0)
    corners = picked(surface, (120, 90), (200, 90), (200, 160), (120, 160))
    points = np.array([pick.point_m for pick in corners])
    expected_m = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    assert straight_length(corners).value == pytest.approx(expected_m, rel=1e-6)
    assert straight_length(along_surface(surface, corners)).value == pytest.approx(
        expected_m, rel=1e-4
    )
    trapezoid_m2 = 0.5 * np.linalg.norm(np.cross(points[2] - points[0], points[3] - points[1]))
    assert planar_area(corners).value == pytest.approx(trapezoid_m2, rel=1e-6)
    area, known = surface_area(surface, corners)
    assert known == 1
    assert area.value == pytest.approx(trapezoid_m2, rel=0.02)


def test_a_bulge_is_longer_along_the_surface() -> None:
    surface = plane()
    y, x = np.mgrid[:240, :320]
    bulge_m = 0.2 * np.exp(-((x - 160) ** 2 + (y - 120) ** 2) / (2 * 30**2))
    range_m = ((2 - bulge_m) * GEOMETRY.ray_length).astype(np.float32)
    line = along_surface(
        FrameSurface(GEOMETRY, range_m, surface.std_blocks_m),
        picked(surface, (60, 120), (260, 120)),
    )
    assert straight_length(line).value > 1.03 * 1.0


def test_the_error_of_a_length_is_that_of_range_and_click() -> None:
    surface = plane(std_m=0.01)
    flat = straight_length(picked(surface, (100, 120), (220, 120)))
    by_click = LIMITS.click_std_px * np.sqrt(2) * 2 / 400
    by_range = np.sqrt(2) * LIMITS.of_range * 0.01 * 60 / 400
    assert flat.std == pytest.approx(np.hypot(by_click, by_range), rel=0.03)
    assert flat.total_std(0.01) == pytest.approx(np.hypot(flat.std, 0.01 * flat.value))
    area = planar_area(picked(surface, (100, 120), (220, 120), (220, 200)))
    assert area.total_std(0.01) == pytest.approx(np.hypot(area.std, 0.02 * area.value))


def test_the_error_of_a_range_grows_as_the_square_of_a_slope() -> None:
    """A ramp is mostly a step that the windows of matching blur."""
    relative = []
    for slope in (0.0, 0.5, 1.0, 2.0):
        (pick,) = picked(plane(slope, std_m=0.0), (160, 120))
        relative.append(pick.range_std_m / pick.range_m)
    assert relative[0] == pytest.approx(0, abs=1e-5)
    np.testing.assert_allclose(
        relative[1:], LIMITS.of_ramp_px / 400 * np.array([0.25, 1, 4]), rtol=0.05
    )


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["length", "area"])
def test_stated_errors_are_those_of_repeated_clicks(kind: str) -> None:
    rng, surface = np.random.default_rng(3), plane(slope=0.5, std_m=1e-6)
    places = np.array([(120, 90), (200, 100), (190, 160), (110, 150)], float)
    of = straight_length if kind == "length" else planar_area
    clicks = rng.normal(places, LIMITS.click_std_px, (400, *places.shape))
    values = [of(picked(surface, *map(tuple, each))).value for each in clicks]
    assert np.std(values) == pytest.approx(of(picked(surface, *map(tuple, places))).std, rel=0.12)


# Edges and holes


@pytest.mark.parametrize("offset_px", [-2, -1, 0, 1, 2])
def test_at_a_silhouette_the_object_is_measured_and_not_what_is_behind(offset_px: int) -> None:
    x = np.arange(320)
    depth_m = np.where(x < 160, 1.0, 2.0)[None, :] * np.ones((240, 1))
    surface = FrameSurface(
        GEOMETRY,
        (depth_m * GEOMETRY.ray_length).astype(np.float32),
        np.full((60, 80), 1e-3, np.float32),
    )
    (pick,) = picked(surface, (159 + offset_px, 120))
    assert pick.point_m[2] == pytest.approx(1.0, rel=1e-3)


def test_single_wrong_pixels_before_the_object_are_not_measured() -> None:
    surface = plane()
    surface.range_m[119:122, 160] = 0.5
    (pick,) = picked(surface, (160, 120))
    assert pick.point_m[2] == pytest.approx(2.0, rel=1e-3)


def test_what_was_not_measured_has_no_range() -> None:
    surface = plane()
    surface.range_m[100:140, 100:140] = np.nan
    assert surface.pick(120, 120) is None
    assert surface.pick(-5, 120) is None
    corners = picked(surface, (90, 90), (150, 90), (150, 150), (90, 150))
    area, known = surface_area(surface, corners)
    assert 0.5 < known < 0.8
    assert area.value == pytest.approx(planar_area(corners).value, rel=0.1)


def test_what_crosses_a_step_carries_it() -> None:
    """A wall that jumps by 0.3 m, away from both ends."""
    depth_m = np.where(np.arange(320) < 160, 2.0, 2.3)[None, :] * np.ones((240, 1))
    surface = plane()
    stepped = FrameSurface(
        GEOMETRY, (depth_m * GEOMETRY.ray_length).astype(np.float32), surface.std_blocks_m
    )
    ends = (100, 120), (220, 120)
    level, over = (
        length_along(along_surface(each, picked(each, *ends))) for each in (surface, stepped)
    )
    assert over.value > level.value + 0.2
    assert over.std > 0.1 * 0.3 > 5 * level.std


@pytest.mark.slow
def test_the_noise_of_slopes_adds_nothing_to_an_area() -> None:
    """A level wall with the noise of matching, alike over 2 pixels."""
    rng, areas = np.random.default_rng(5), []
    for _ in range(6):
        noise = cv2.GaussianBlur(rng.standard_normal((240, 320)), (0, 0), 2.0)
        range_m = 2 * GEOMETRY.ray_length * (1 + 0.003 * noise / noise.std())
        surface = FrameSurface(
            GEOMETRY, range_m.astype(np.float32), np.full((60, 80), 0.006, np.float32)
        )
        corners = picked(surface, (100, 90), (180, 90), (180, 160), (100, 160))
        area, _ = surface_area(surface, corners)
        areas.append((area.value, area.std))
    values, stds = np.array(areas).T
    assert values.mean() == pytest.approx(80 * 70 * (2 / 400) ** 2, abs=stds.mean())


# The terrain of a map


def ground(heights_m: np.ndarray, std_m: float = 1e-4) -> Ground:
    """Cells of 1 cm, whose north-west corner lies at (5, 3)."""
    return Ground(heights_m.astype(np.float32), Grid(5.0, 3.0, 0.01, heights_m.shape), std_m)


def slope(east: float = 0.5, north: float = 0.0) -> Ground:
    y, x = np.mgrid[:80, :120]
    return ground(-2 + east * 0.01 * (x + 0.5) - north * 0.01 * (y + 0.5))


def spots(terrain: Ground, *places: tuple[float, float]) -> list[Spot]:
    found = [terrain.pick(x_m, y_m, None, 0.002) for x_m, y_m in places]
    assert None not in found
    return [spot for spot in found if spot is not None]


@pytest.mark.slow
def test_on_a_slope_points_lengths_and_areas_are_those_of_a_plane() -> None:
    terrain = slope(east=0.5)
    corners = spots(terrain, (5.2, 2.8), (5.8, 2.8), (5.8, 2.4), (5.2, 2.4))
    assert corners[0].point_m[2] == pytest.approx(-2 + 0.5 * 0.2, abs=1e-5)
    assert straight_length(corners[:2]).value == pytest.approx(0.6 * np.hypot(1, 0.5), rel=1e-5)
    line = terrain.along(corners[:2])
    assert line
    assert straight_length(line).value == pytest.approx(0.6 * np.hypot(1, 0.5), rel=1e-4)
    assert planar_area(corners).value == pytest.approx(0.24 * np.hypot(1, 0.5), rel=1e-5)
    area = terrain.area(corners)
    assert area
    assert area[0].value == pytest.approx(0.24 * np.hypot(1, 0.5), rel=1e-4) and area[
        1
    ] == pytest.approx(1, abs=0.05)


@pytest.mark.parametrize("alike_cells", [1.0, 2.0, 4.0])
def test_an_area_of_the_map_carries_the_roughness_that_errors_of_ranges_add(
    alike_cells: float,
) -> None:
    """Flat ground of four frames, in cells finer than their errors differ."""
    std_m = 0.005 * alike_cells
    heights = np.zeros((120, 160))
    rng, kernel = np.random.default_rng(2), (0, 0)
    noise = cv2.GaussianBlur(rng.standard_normal(heights.shape), kernel, alike_cells / np.sqrt(2))
    terrain = replace(
        ground(heights + std_m / 2 * noise / noise.std(), std_m), correlation_m=0.01 * alike_cells
    )
    z = []
    for west_m in (5.1, 5.5, 5.9, 6.3):
        for north_m in (2.9, 2.5, 2.1):
            east_m, south_m = west_m + 0.25, north_m - 0.25
            corners = ((west_m, north_m), (east_m, north_m), (east_m, south_m), (west_m, south_m))
            found = terrain.area(spots(terrain, *corners))
            assert found
            z.append((found[0].value - 0.25**2) / found[0].std)
    assert np.mean(np.abs(z) < 2) > 0.9


def test_a_height_beside_a_hole_carries_a_part_of_the_step_that_it_hides() -> None:
    """A block of 0.3 m, whose foot on one side no frame saw."""
    heights = np.zeros((80, 80))
    heights[:, :40] = 0.3
    heights[:40, 40:46] = np.nan
    terrain = Ground(heights.astype(np.float32), Grid(0.0, 0.8, 0.01, (80, 80)), 0.004)
    rim, inner, low = (terrain.height_std_m(x, 0.6) for x in (0.395, 0.15, 0.465))
    assert rim == pytest.approx(OF_RELIEF * 0.3 * np.exp(-1 / HOLE_CELLS), rel=0.05)
    assert low == pytest.approx(rim, rel=0.05)
    assert inner == pytest.approx(0, abs=1e-6)


def test_a_height_on_rough_ground_carries_its_roughness() -> None:
    rng = np.random.default_rng(1)
    heights_m = rng.normal(0, 0.02, (60, 60)).astype(np.float32)
    rough = Ground(heights_m, Grid(0.0, 0.6, 0.01, (60, 60)), 0.004)
    smooth = replace(rough, heights_m=0.05 * heights_m)
    assert rough.height_std_m(0.3, 0.3) == pytest.approx(OF_ROUGHNESS * 0.02, rel=0.25)
    assert smooth.height_std_m(0.3, 0.3) < 0.1 * rough.height_std_m(0.3, 0.3)


def test_a_length_along_the_map_puts_back_what_is_smoothed_away() -> None:
    """A plane loses nothing, waves a tenth of what they are longer; half of it is in the error."""
    plane, waves = slope(east=0.5), slope(east=0.0)
    x_m = np.arange(waves.heights_m.shape[1]) * 0.01
    waves = replace(
        waves,
        heights_m=(0.1 * np.sin(2 * np.pi * x_m / 0.4) + 0 * waves.heights_m).astype(np.float32),
    )
    for ground, longer in ((plane, False), (waves, True)):
        ends = spots(ground, (5.2, 2.6), (5.8, 2.6))
        line, found = ground.along(ends), ground.length(ends)
        assert line and found
        added_m = found.value - length_along(line).value
        excess_m = length_along(line).value - straight_length(ends).value
        assert added_m == pytest.approx(0.1 * max(excess_m, 0), abs=1e-6)
        assert (added_m > 0.005) is longer and found.std >= added_m / 2


@pytest.mark.slow
def test_the_error_on_a_map_is_that_of_height_and_click() -> None:
    terrain = replace(slope(east=0.5), std_m=0.004)
    (spot,) = spots(terrain, (5.5, 2.5))
    height_m = PLACE_CELLS * 0.01 * 0.5  # of a slope
    assert spot.covariance[2, 2] == pytest.approx(height_m**2 + (0.5 * 0.002) ** 2, rel=1e-3)
    rng, ends = np.random.default_rng(4), np.array([(5.2, 2.7), (5.7, 2.4)])
    lengths = []
    for _ in range(400):
        clicked = [terrain.pick(x, y, None, 0.002) for x, y in rng.normal(ends, 0.002)]
        points = np.array([spot.point_m for spot in clicked if spot]) + rng.normal(
            0, height_m, (2, 1)
        ) * (0, 0, 1)
        lengths.append(np.linalg.norm(points[1] - points[0]))
    assert np.std(lengths) == pytest.approx(
        straight_length(spots(terrain, *map(tuple, ends))).std, rel=0.12
    )


@pytest.mark.parametrize("stds", [1, 2, 3.5])
def test_heights_that_count_squared_stay_within_their_standard_errors(stds: float) -> None:
    """A corner of a level square, and an end of a level line, that lie too high."""
    size_m, height_m = 0.3, 0.03
    places = [(0.0, 0.0), (size_m, 0.0), (size_m, size_m), (0.0, size_m)]

    def points(off_m: float) -> list[Spot]:
        heights_m = (off_m, 0.0, 0.0, 0.0)
        covariance = np.diag([0.0, 0.0, height_m**2])
        return [
            Spot(np.array([*place, z_m]), covariance, 0.0, (0.0, 0.0))
            for place, z_m in zip(places, heights_m, strict=True)
        ]

    for measure_of in (planar_area, lambda corners: straight_length(corners[:2])):
        wrong, right = measure_of(points(stds * height_m)), measure_of(points(0.0))
        assert 0 < wrong.value - right.value < 5 * right.std
    # not far more: a square of which one corner is known worse than the others
    one = [replace(each, covariance=(n == 0) * each.covariance) for n, each in enumerate(points(0))]
    by_corner_m2 = planar_area(points(12.5**0.5 * height_m)).value - size_m**2
    assert 5 * planar_area(one).std == pytest.approx(by_corner_m2, rel=0.1)


@pytest.mark.parametrize("offset_cells", [-1, 0, 1, 2])
def test_at_the_edge_of_a_coral_its_top_is_measured(offset_cells: int) -> None:
    heights_m = np.where(np.arange(120) < 60, -1.5, -2.0)[None, :] * np.ones((80, 1))
    (spot,) = spots(ground(heights_m), (5 + 0.01 * (59.5 + offset_cells), 2.5))
    assert spot.point_m[2] == pytest.approx(-1.5 if offset_cells < 2 else -2.0, abs=1e-4)


BUMP_M, BUMP_HEIGHT_M, STD_M, ALIKE_M = 0.15, 0.06, 0.004, 0.02


def bump_on_a_slope() -> tuple[Ground, list[Spot]]:
    """A paraboloid on a plane, and an outline around it."""
    y, x = (np.mgrid[:60, :60] + 0.5) * 0.01
    far = np.hypot(x - 0.3, y - 0.3)
    bump = BUMP_HEIGHT_M * np.maximum(1 - (far / BUMP_M) ** 2, 0)
    terrain = replace(ground(0.3 * x - 0.1 * y + bump, STD_M), correlation_m=ALIKE_M)
    turn = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    corners = np.column_stack([5.3 + 0.17 * np.cos(turn), 2.7 + 0.17 * np.sin(turn)])
    return terrain, [
        spot for x, y in corners.tolist() if (spot := terrain.pick(x, y, None, 0.0)) is not None
    ]


@pytest.mark.slow
def test_a_volume_is_that_of_a_paraboloid_and_its_error_that_of_heights() -> None:
    ground, spots = bump_on_a_slope()
    volume = volume_above(ground, spots)
    assert volume is not None and volume.power == 3
    assert volume.value == pytest.approx(500 * np.pi * BUMP_M**2 * BUMP_HEIGHT_M, rel=0.02)

    def measured(heights_m: np.ndarray) -> np.ndarray:
        moved = replace(ground, heights_m=heights_m.astype(np.float32))
        found = volume_above(moved, spots)
        assert found is not None
        return np.array([found.value])

    heights = ground.heights_m.astype(np.float64)
    spread = spread_of(
        measured, heights, np.full_like(heights, STD_M), ALIKE_M / ground.grid.cell_m
    )
    assert volume.std == pytest.approx(spread[0], rel=0.4)  # 24 draws know it to 15 %


def test_a_hollow_has_no_volume_and_steps_make_one_uncertain() -> None:
    ground, spots = bump_on_a_slope()
    assert volume_above(replace(ground, heights_m=-ground.heights_m), spots) is None
    table = ground.heights_m.copy()
    table[15:45, 15:45] += 0.2
    corners = [(5.15, 2.85), (5.45, 2.85), (5.45, 2.55), (5.15, 2.55)]
    ground = replace(ground, heights_m=table)
    spots = [spot for corner in corners if (spot := ground.pick(*corner, None, 0.0))]
    volume = volume_above(ground, spots)
    assert volume is not None
    assert volume.std == pytest.approx(volume.value / np.sqrt(3), rel=0.1)


def test_what_stands_over_the_ground_has_no_length_along_it() -> None:
    terrain = slope()
    over = terrain.pick(5.5, 2.5, -1.0, 0.002)
    assert over
    assert over.point_m[2] == -1.0
    assert terrain.along([over, *spots(terrain, (5.2, 2.5))]) is None
    steep = [terrain.pick(5.5, y, z, 0.002) for y, z in ((2.5, -1.75), (2.6, -1.75), (2.6, -1.2))]
    assert terrain.area([spot for spot in steep if spot]) is None
    assert terrain.pick(4.0, 2.5, None, 0.002) is None


# The synthetic reef


@pytest.fixture(scope="module")
def reef(tmp_path_factory: pytest.TempPathFactory) -> FinishedRun:
    """Ranges of three frames of the sample dive."""
    root = tmp_path_factory.mktemp("reef")
    for side in ("left", "right"):
        (root / side).mkdir()
        for path in sorted((REEF / side).iterdir())[1::4]:
            (root / side / path.name).symlink_to(path)
    range_maps(root / "left", root / "right", REEF / "cam.yaml", root / "out")
    return open_run(root / "out")


def known_lengths(run: FinishedRun, count: int, seed: int) -> Iterator[tuple[float, float, float]]:
    """(true length, measured length, stated error) of lines of 0.05 to 2 m, clicked half a pixel
    beside their true ends.

    Ends lie where the truth has no edge within four pixels: which side of an edge a click means, no
    truth can say.
    """
    rng, near = np.random.default_rng(seed), np.ones((9, 9), np.uint8)
    frames = []
    for frame in run.frames:
        truth_m = cv2.imread(str(REEF / f"truth/range/{frame.name}.tiff"), cv2.IMREAD_UNCHANGED)
        steady = cv2.dilate(truth_m, near) - cv2.erode(truth_m, near) < 0.05 * truth_m
        frames.append((surface_of(run, frame.name), truth_m, steady))
    while count:
        surface, truth_m, steady = frames[rng.integers(len(frames))]
        g, (height, width) = surface.geometry, truth_m.shape
        start = rng.uniform(4, (width - 5, height - 5)).round()
        length_px = (
            np.exp(rng.uniform(np.log(0.05), np.log(2)))
            * g.focal_px
            / truth_m[int(start[1]), int(start[0])]
        )
        angle = rng.uniform(0, 2 * np.pi)
        ends = np.array(
            [start, (start + length_px * np.array([np.cos(angle), np.sin(angle)])).round()]
        )
        if (
            (ends < 4).any()
            or (ends > (width - 5, height - 5)).any()
            or not all(steady[int(y), int(x)] for x, y in ends)
        ):
            continue
        true_m = [truth_m[int(y), int(x)] * g.rays[int(y), int(x)].astype(float) for x, y in ends]
        picks = [surface.pick(*place) for place in rng.normal(ends, LIMITS.click_std_px)]
        length_m = float(np.linalg.norm(true_m[1] - true_m[0]))
        if 0.05 <= length_m <= 2 and picks[0] and picks[1]:
            found = straight_length([picks[0], picks[1]])
            yield length_m, found.value, found.std
            count -= 1


@pytest.mark.slow
def test_200_known_lengths_are_found_and_their_intervals_hold(reef: FinishedRun) -> None:
    true_m, found_m, std_m = np.array(list(known_lengths(reef, 200, seed=11))).T
    relative, inside = (found_m - true_m) / true_m, abs(found_m - true_m) < 1.96 * std_m
    assert abs(found_m.sum() / true_m.sum() - 1) < 0.005
    # short lines scatter by more than half a percent
    assert abs(relative.mean()) < 3 * relative.std() / np.sqrt(relative.size)
    assert 0.93 <= inside.mean() <= 0.97


def test_of_an_outline_half_off_the_surface_the_known_part_is_measured() -> None:
    """A wall at 2 m of which the right half is not known; corners on the known side and beyond."""
    pair = RectifiedPair(500.0, 160.0, 160.0, 120.0, 0.1, (320, 240))
    range_m = (2 * pair.ray_length).astype(np.float32)
    range_m[:, 160:] = np.nan
    surface = FrameSurface(pair, range_m, np.full((60, 80), 0.004, np.float32))
    corners = ((100, 80), (220, 80), (220, 160), (100, 160))
    (wanted,) = [Wanted("a", "0", "area", "", corners)]
    found = measured(surface, wanted, 0.0)
    assert found.value is None and "place 2: the surface is unknown there" in found.note
    assert found.known == pytest.approx(0.5, abs=0.05)
    assert found.surface == pytest.approx(60 * 80 * (2 / 500) ** 2, abs=2 * found.surface_std)
    assert f"{found.known:.0%} of the outline" in found.note


@pytest.mark.slow
def test_an_unknown_part_of_an_outline_is_in_its_standard_error() -> None:
    pair = RectifiedPair(500.0, 160.0, 160.0, 120.0, 0.1, (320, 240))
    depth_m = np.tile(np.linspace(1.5, 2.5, 320), (240, 1))
    range_m = (depth_m * pair.ray_length).astype(np.float32)
    corners = ((60, 60), (260, 60), (260, 180), (60, 180))
    stds = []
    for unknown in (slice(0, 0), slice(90, 230)):
        holed = range_m.copy()
        holed[:, unknown] = np.nan
        found = measured(
            FrameSurface(pair, holed, np.full((60, 80), 0.004, np.float32)),
            Wanted("a", "0", "area", "", corners),
            0.0,
        )
        assert found.surface is not None and found.surface_std is not None
        stds.append(found.surface_std / found.surface)
    assert found.known == pytest.approx(0.33, abs=0.06)
    assert stds[1] > 5 * stds[0] and stds[1] > 0.1


def test_an_end_beside_a_nearer_thing_is_at_a_step_and_no_length() -> None:
    """A plate at 1.5 m before a bottom at 3 m, whose ranges end four pixels before its edge, as
    they do there.
    """
    pair = RectifiedPair(500.0, 160.0, 160.0, 120.0, 0.1, (320, 240))
    depth_m = np.full((240, 320), 3.0)
    depth_m[100:140, 100:200] = 1.5
    depth_m[100:140, 196:200] = np.nan
    surface = FrameSurface(
        pair, (depth_m * pair.ray_length).astype(np.float32), np.full((60, 80), 0.004, np.float32)
    )
    within, edge, far = (
        measured(surface, Wanted("a", "0", "length", "", ((104, 120), (x, 120))), 0.0)
        for x in (194, 201, 260)
    )
    assert within.value == pytest.approx(90 * 1.5 / 500, rel=0.01) and within.note == ""
    assert (
        edge.value is None
        and "place 2 lies at a step, 3.00 m away, next to an object 1.50 m away" in edge.note
    )
    assert far.value is not None and far.note == ""


# The command


@pytest.fixture
def out(copy_run: CopyRun, tmp_path: Path) -> Path:
    return copy_run(tmp_path / "out", 2)


def table(path: Path, *rows: str) -> Path:
    path.write_text("\n".join(["measure,frame,kind,label,x_px,y_px", *rows]) + "\n")
    return path


@pytest.mark.slow
def test_a_table_of_places_is_measured(out: Path, tmp_path: Path) -> None:
    rows = ("a,0000,length,coral,60,60", "a,0000,length,coral,100,60", "b,0001,point,,88,64")
    length, point = measure(out, table(tmp_path / "points.csv", *rows))
    surface = surface_of(open_run(out), "0000")
    assert (length.label, length.kind) == ("coral", "length")
    assert length.value == pytest.approx(
        straight_length(picked(surface, (60, 60), (100, 60))).value, rel=1e-12
    )
    assert point.z_m == pytest.approx(1.5, rel=0.02)


@pytest.mark.slow
def test_the_command_prints_a_table(out: Path, tmp_path: Path, cli: Cli) -> None:
    rows = (
        "a,0000,area,,60,60",
        "a,0000,area,,100,60",
        "a,0000,area,,100,90",
        "b,0000,point,,-50,3",
    )
    code, text, _ = cli("measure", out, table(tmp_path / "points.csv", *rows))
    found = list(csv.DictReader(io.StringIO(text)))
    assert code == 3  # b lies outside the picture
    assert float(found[0]["surface"]) == pytest.approx(float(found[0]["value"]), rel=0.1)
    assert (found[1]["measure"], found[1]["value"]) == ("b", "")
    assert found[1]["note"].startswith("place 1: lies outside the corrected image of ")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (["a,0000,line,,1,2"], r"line 2: kind is 'line': give point, length or area"),
        (["a,0000,point,,x,2"], r"line 2: x_px is 'x': give a number"),
        (["a,0000,point,,2,nan"], r"line 2: y_px is 'nan': give a number"),
        (["a,0000,length,,50,50"], r"measure 'a': length needs at least 2 places"),
        (
            ["a,0000,length,,50,50", "a,0001,length,,50,50"],
            r"line 3: measure 'a' has another frame or kind than before",
        ),
        (["a,0009,point,,50,50"], r"holds no finished frame '0009'"),
        (["a,,point,,,"], r"x_m is '': give a number"),
        (["a,0000,point,,inf,2"], r"line 2: x_px is 'inf': give a number"),
        (
            [f"a,0000,area,,{place}" for place in ("60,60", "100,90", "100,60", "60,90")],
            r"measure 'a': the outline crosses itself",
        ),
    ],
)
def test_a_table_that_cannot_be_used_is_named(
    out: Path, tmp_path: Path, rows: list[str], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        measure(out, table(tmp_path / "points.csv", *rows))


@pytest.mark.slow
def test_a_table_without_its_columns_is_named(out: Path, tmp_path: Path) -> None:
    (tmp_path / "points.csv").write_text("x,y\n1,2\n")
    with pytest.raises(
        InputError, match=r"has no column 'measure' in its first line: give the columns measure"
    ):
        measure(out, tmp_path / "points.csv")


DAMAGED = json.dumps(
    {
        "format": "stereo-seecolor measures 1",
        "dive": "d",
        "offset_m": [0, 0, 0],
        "measures": [
            {
                "id": 3,
                "frame": "",
                "kind": "point",
                "label": "",
                "places": [],
                "points": [[0, 0, 0]],
            }
        ],
    }
)
"""A point of the map without how well it was hit."""


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{}", "is not a file of measures as the page saves it"),
        ("[1]", "is not a file of measures as the page saves it"),
        ('{"format": "stereo-seecolor measures 1"}', "dive: "),
        (DAMAGED, "measure 3 is damaged"),
    ],
)
def test_a_file_of_measures_that_cannot_be_used_is_named(
    out: Path, tmp_path: Path, content: str, message: str
) -> None:
    (tmp_path / "measures.json").write_text(content)
    with pytest.raises(InputError, match=message):
        measure(out, tmp_path / "measures.json")


@pytest.mark.slow
def test_places_on_a_map_need_a_map(out: Path, tmp_path: Path) -> None:
    (tmp_path / "points.csv").write_text("measure,frame,kind,label,x_m,y_m\na,,point,,1,2\n")
    with pytest.raises(InputError, match="holds no terrain"):
        measure(out, tmp_path / "points.csv")


@pytest.mark.slow
def test_lengths_as_eventmeasure_has_them(out: Path, tmp_path: Path, cli: Cli) -> None:
    fish, bar = "a,0001,length,Lutjanidae Lutjanus bohar,", "b,0001,length,bar,"
    rows = [f"{row}{place}" for row in (fish, bar) for place in ("60,60", "100,60")]
    points = table(tmp_path / "points.csv", *rows, "c,0001,point,,88,64")
    code, printed, _ = cli("measure", out, points, "--lengths")
    fish, bar = csv.DictReader(io.StringIO(printed), delimiter="\t")
    assert code == 0
    length = measure(out, points)[0]
    assert float(fish["Length (mm)"]) == pytest.approx(1000 * length.value, abs=0.01)
    assert float(fish["Precision (mm)"]) == pytest.approx(1000 * length.std, abs=0.01)
    assert [fish[name] for name in ("Family", "Genus", "Species", "Number", "RMS (mm)")] == [
        "Lutjanidae",
        "Lutjanus",
        "bohar",
        "1",
        "",
    ]
    assert (bar["Comment"], bar["Genus"], bar["OpCode"], bar["Frame"]) == (
        "bar",
        "",
        out.name,
        "0001",
    )
    middle = np.array([float(fish[f"Mid {axis} (mm)"]) for axis in "XYZ"])
    assert float(fish["Range (mm)"]) == pytest.approx(np.linalg.norm(middle), abs=0.02)
    assert float(fish["Direction (deg)"]) == pytest.approx(
        np.degrees(np.arccos(middle[2] / np.linalg.norm(middle))), abs=0.01
    )
    assert float(fish["Horz. Dir. (deg)"]) == pytest.approx(
        np.degrees(np.arctan2(middle[0], middle[2])), abs=0.01
    )
    assert fish["Time (mins)"] == "", "the frames tell no time"


def test_a_table_without_rows_is_refused(tmp_path: Path) -> None:
    (tmp_path / "p.csv").write_text("measure,frame,kind,label,x_px,y_px\n")
    with pytest.raises(InputError, match=r"p.csv: holds no rows below its header"):
        read_wanted(tmp_path / "p.csv")
