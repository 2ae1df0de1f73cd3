"""Structure, colonies and cover of a site: against closed forms, and with standard errors that
hold.
"""

import csv
import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import rasterio
from conftest import SampleRun
from json_shapes import SHAPES, mismatch
from mapping_scene import flat_frames, write_map
from numpy.typing import NDArray

from stereo_seecolor.color.white_point import white_doubt
from stereo_seecolor.earth import degrees_from_north_east
from stereo_seecolor.errors import InputError, OutputError
from stereo_seecolor.extras.reef.colony import Colony, ColonySize, measure_outlines
from stereo_seecolor.extras.reef.cover import cover
from stereo_seecolor.extras.reef.ground_volume import volume_above
from stereo_seecolor.extras.reef.lengths_and_areas import planar_area
from stereo_seecolor.extras.reef.map_ground import Ground
from stereo_seecolor.extras.reef.measure import Wanted, measured_on_map
from stereo_seecolor.extras.reef.metric_tables import SiteMetrics
from stereo_seecolor.extras.reef.metrics import metrics
from stereo_seecolor.extras.reef.outline_files import read_outlines
from stereo_seecolor.extras.reef.outlines import Outline
from stereo_seecolor.extras.reef.reef_texts import metrics_text
from stereo_seecolor.extras.reef.site_surface import SiteMesh, read_mesh
from stereo_seecolor.extras.reef.terrain_of_mesh import grid_of, terrain_errors, terrain_of
from stereo_seecolor.mapping.raster.grid import Grid
from stereo_seecolor.mapping.raster.noise import peaks, smoothed
from stereo_seecolor.mapping.raster.sides import sides_seen
from stereo_seecolor.mapping.raster.square_metrics import mean_height_range
from stereo_seecolor.mapping.raster.structure import (
    Numbers,
    StructureAtScale,
    numbers_of,
    squares_of,
    structure,
)
from stereo_seecolor.mapping.raster.terrain import Terrain, TerrainErrors
from stereo_seecolor.records import GeoOrigin
from stereo_seecolor.report.facts import DiveFacts
from stereo_seecolor.report.methods import methods
from stereo_seecolor.report.overview import dive_facts
from stereo_seecolor.report.texts import digits, phrase
from stereo_seecolor.report.verdict import judge
from stereo_seecolor.run_folder.finished_map import open_map
from stereo_seecolor.run_folder.finished_run import open_run
from stereo_seecolor.run_folder.posed_run import PosedRun, open_posed_run

CELL_M = 0.01
STD_M = 0.001
"""Of a height in one frame."""
RIM_M = 0.1743
"""Around a dome of 0.15 m; no center of a cell lies on it."""
Array = NDArray[np.float64]


def mesh_of(height: Callable[[Array, Array], Array], half_m: float = 0.3) -> SiteMesh:
    """z = height(x, y) over a square, triangulated at CELL_M."""
    steps = round(half_m / CELL_M)
    x, y = np.meshgrid(*(np.arange(-steps, steps + 1) * CELL_M,) * 2)
    points = np.stack([x, y, height(x, y)], axis=-1).reshape(-1, 3)
    n = 2 * steps + 1
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    triangles = np.concatenate(
        [corner[:, None] + [0, 1, n], corner[:, None] + [1, n + 1, n]]
    ).astype(np.int32)
    return SiteMesh(
        points, np.tile([0.0, 0, 1], (n * n, 1)), np.full((n * n, 3), 90, np.uint8), triangles
    )


def site(
    mesh: SiteMesh, std_m: float = 0.003, correlation_m: float = 0.01
) -> tuple[Terrain, TerrainErrors]:
    terrain = terrain_of(mesh, grid_of(mesh, CELL_M))
    std, views = np.full(terrain.grid.shape, std_m), np.full(terrain.grid.shape, 4, np.int32)
    return terrain, TerrainErrors(std, std, views, correlation_m)


def circle(radius_m: float, name: str = "a", label: str = "") -> Outline:
    angle = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    return Outline(name, label, (radius_m * np.stack([np.cos(angle), np.sin(angle)], axis=-1),))


def dome(x: Array, y: Array, radius_m: float = 0.15) -> Array:
    return np.sqrt(np.maximum(radius_m**2 - x**2 - y**2, 0))


def numbers(heights: Array) -> Numbers:
    return Numbers(*numbers_of(heights, CELL_M, [np.s_[:, :]])[0], np.nan)


def test_a_slope_has_the_dimension_of_a_plane_and_the_rugosity_of_its_tilt() -> None:
    row, column = np.indices((200, 200))
    across = 0.5 / np.sqrt(2) * 0.01 * (row + column)  # rises by 0.5 along the diagonal
    found = numbers(across)
    assert found.rugosity_area == pytest.approx(np.sqrt(1 + 0.5**2), abs=1e-9)
    assert found.height_range_m == pytest.approx(across.max() - across.min())
    assert found.fractal_dimension == pytest.approx(2, abs=0.03)
    # by ranges of the heights at cells' centers: 12 of them span 11 cells, a range of sqrt(2) 0.5
    # 11 / 12 of the edge
    assert found.rugosity_hvar == pytest.approx(np.sqrt(1 + 0.5**2), abs=0.03)
    flat = numbers(np.zeros((64, 64)))
    assert (flat.rugosity_hvar, flat.fractal_dimension, flat.height_range_m) == (1, 2, 0)
    assert flat.rugosity_area == pytest.approx(1)


@pytest.mark.parametrize(("dimension", "tolerance"), [(2.2, 0.25), (2.5, 0.12), (2.8, 0.12)])
def test_the_dimension_of_a_fractal_surface_is_found(dimension: float, tolerance: float) -> None:
    """Height ranges are known to say too much of a smooth surface: their largest square holds few
    independent heights.
    """
    heights = fractal(dimension)[:512, :512]
    assert numbers(heights).fractal_dimension == pytest.approx(dimension, abs=tolerance)


def fractal(dimension: float) -> NDArray[np.float64]:
    """(1024, 1024) heights of unit variance."""
    n, rng = 1024, np.random.default_rng(3)
    frequency = np.hypot(np.fft.fftfreq(n)[:, None], np.fft.rfftfreq(n)[None, :])
    frequency[0, 0] = np.inf
    spectrum = np.fft.rfft2(rng.standard_normal((n, n))) * frequency ** -(3 - dimension + 1)
    heights = np.fft.irfft2(spectrum)
    return np.asarray(heights / heights.std())


@pytest.mark.slow
@pytest.mark.parametrize("dimension", [2.1, 2.3])
def test_what_smoothing_takes_from_ranges_and_slopes_is_put_back(dimension: float) -> None:
    true_m, sigma = 0.1 * fractal(dimension)[:400, :400], 1.5
    grid = Grid(0.0, 4.0, CELL_M, true_m.shape)
    terrain = Terrain(grid, true_m, np.full((*true_m.shape, 3), np.nan, np.float32))
    mapped = replace(terrain, height_m=cv2.GaussianBlur(true_m, (0, 0), sigma))
    nothing, views = np.zeros(grid.shape), np.ones(grid.shape, np.int32)
    errors = TerrainErrors(nothing, nothing, views, sigma / 0.85 * CELL_M)
    found = {each.edge_m: each for each in structure(mapped, errors)}
    for edge_m in (0.5, 1.0, 2.0):
        scale_m = found[edge_m].scale_m
        coarse = terrain.averaged(round(scale_m / CELL_M))
        true = Numbers(
            *numbers_of(coarse.height_m, scale_m, squares_of(coarse)[edge_m]).mean(axis=0), 0.0
        )
        mean, before = found[edge_m].mean, found[edge_m].mapped
        assert mean.height_range_m == pytest.approx(true.height_range_m, rel=0.02)
        assert mean.vector_ruggedness == pytest.approx(true.vector_ruggedness, rel=0.03)
        assert before.vector_ruggedness < 0.9 * true.vector_ruggedness


@pytest.mark.slow
def test_a_height_range_has_the_error_of_the_calibration_and_ratios_have_none() -> None:
    heights_m = 0.05 * np.random.default_rng(3).normal(size=(60, 60))
    grid = Grid(0.0, 0.6, CELL_M, heights_m.shape)
    terrain = Terrain(grid, heights_m, np.full((*heights_m.shape, 3), np.nan, np.float32))
    nothing, views = np.full(grid.shape, 1e-4), np.ones(grid.shape, np.int32)
    found = structure(terrain, TerrainErrors(nothing, nothing, views, CELL_M))[-1]
    own, both = found.standard_error, found.with_calibration(0.05).standard_error
    assert both.height_range_m == pytest.approx(
        np.hypot(own.height_range_m, 0.05 * found.mean.height_range_m)
    )
    assert replace(both, height_range_m=0.0, mesh_rugosity=0.0) == replace(
        own, height_range_m=0.0, mesh_rugosity=0.0
    )


def test_height_ranges_leave_out_squares_that_were_hardly_seen() -> None:
    heights = np.zeros((8, 8))
    heights[:4, :4], heights[0, 0] = np.nan, 50.0
    heights[4:, 4:] = np.arange(16).reshape(4, 4)
    assert mean_height_range(heights, 2) == pytest.approx((0 + 0 + 15) / 3)
    assert np.isnan(mean_height_range(np.full((8, 8), np.nan), 2))


def test_a_half_sphere_has_its_volume_surface_and_height() -> None:
    mesh = mesh_of(dome)
    terrain, errors = site(mesh, 1e-4)
    (colony,) = measure_outlines([circle(RIM_M)], mesh, terrain, errors, STD_M)
    assert colony is not None
    ring_m2 = np.pi * (RIM_M**2 - 0.15**2)
    assert colony.measured.planar_m2 == pytest.approx(np.pi * RIM_M**2, rel=0.01)
    assert colony.measured.volume_l == pytest.approx(1000 * 2 / 3 * np.pi * 0.15**3, rel=0.01)
    assert colony.measured.height_m == pytest.approx(0.15, abs=1e-3)
    # steep cells at the foot
    assert colony.measured.mesh_m2 == pytest.approx(2 * np.pi * 0.15**2 + ring_m2, rel=0.03)
    # which three cells show less of
    assert colony.measured.surface_m2 == pytest.approx(2 * np.pi * 0.15**2 + ring_m2, rel=0.05)
    assert (colony.views, colony.unseen) == (4, 0)


def test_a_volume_stands_above_ground_that_slopes() -> None:
    mesh = mesh_of(lambda x, y: dome(x, y) + 0.4 * x - 0.2 * y)
    terrain, errors = site(mesh)
    (colony,) = measure_outlines([circle(RIM_M)], mesh, terrain, errors, STD_M)
    assert colony is not None and colony.measured.volume_l == pytest.approx(
        1000 * 2 / 3 * np.pi * 0.15**3, rel=0.01
    )


@pytest.mark.slow
def drum(x: Array, y: Array) -> Array:
    return np.where(np.hypot(x, y) < 0.15, 0.2, 0.0)


def test_the_volume_of_a_table_may_be_empty_below_where_its_sides_were_not_seen() -> None:
    """A drum whose sides are in the mesh, and one without."""
    closed = mesh_of(drum)
    heights = closed.points_m[:, 2][closed.triangles]
    level = np.ptp(heights, axis=1) < 0.1
    found = []
    for mesh in (closed, replace(closed, triangles=closed.triangles[level])):
        terrain, errors = site(mesh, std_m=0.001)
        (colony,) = measure_outlines([circle(0.155)], mesh, terrain, errors, 0.001)
        assert colony
        found.append((colony.measured.volume_l, colony.standard_error.volume_l))
    (full_l, std_l), (table_l, table_std_l) = found
    assert std_l < 0.1 * full_l and full_l == pytest.approx(1000 * np.pi * 0.15**2 * 0.2, rel=0.1)
    assert table_std_l == pytest.approx(table_l / np.sqrt(3), rel=0.2)


@pytest.mark.parametrize("shape", ["dome", "drum", "table"])
def test_a_volume_and_its_error_are_those_of_the_page(shape: str) -> None:
    """As ``measure`` and the page state them, with the sides that the mesh holds; of each shape
    other parts of the standard error count most.
    """
    mesh = mesh_of({"dome": dome}.get(shape, drum))
    if shape == "table":
        heights = mesh.points_m[:, 2][mesh.triangles]
        mesh = replace(mesh, triangles=mesh.triangles[np.ptp(heights, axis=1) < 0.1])
    terrain, errors = site(mesh, std_m=0.002)
    outline = circle(0.155)
    (colony,) = measure_outlines([outline], mesh, terrain, errors, 0.002, 0.003, 0.005, 0.02)
    grid = terrain.grid
    bare = Ground(terrain.height_m.astype(np.float32), grid, 0.002)
    sides = sides_seen(terrain.height_m, mesh.area_over(grid), grid.cell_m, bare.gap_m)
    ground = replace(bare, sides=sides, correlation_m=0.02)
    corners = outline.rings[0].tolist()
    spots = [spot for x, y in corners if (spot := ground.pick(x, y, None, 0.003))]
    volume = volume_above(ground, spots)
    assert colony is not None and volume is not None
    assert colony.measured.volume_l == pytest.approx(volume.value, rel=1e-9)
    assert colony.standard_error.volume_l == pytest.approx(volume.total_std(0.005), rel=1e-9)


def test_areas_of_an_outline_have_the_errors_of_its_corners_and_of_the_calibration() -> None:
    """As the page and ``measure`` state them of the same outline."""
    mesh = mesh_of(lambda x, y: 0.3 * x)
    terrain, errors = site(mesh, std_m=0.002)
    square = Outline("a", "", (np.array([[-0.1, -0.1], [0.1, -0.1], [0.1, 0.1], [-0.1, 0.1]]),))
    (colony,) = measure_outlines([square], mesh, terrain, errors, 0.002, 0.003, 0.005)
    assert colony
    grid = terrain.grid
    alike_m = errors.correlation_m
    ground = Ground(terrain.height_m.astype(np.float32), grid, 0.002, correlation_m=alike_m)
    spots = [spot for x, y in square.rings[0] if (spot := ground.pick(x, y, None, 0.003))]
    flat, on_ground = planar_area(spots), ground.area(spots)
    assert on_ground is not None
    assert colony.measured.tilted_m2 == pytest.approx(flat.value)
    assert colony.standard_error.tilted_m2 == pytest.approx(flat.total_std(0.005))
    assert colony.measured.surface_m2 == pytest.approx(on_ground[0].value)
    assert colony.standard_error.surface_m2 == pytest.approx(
        on_ground[0].total_std(0.005), rel=0.02
    )
    by_clicks = 0.003 / 2 * np.sqrt(4 * 2 * 0.2**2)
    assert colony.standard_error.planar_m2 == pytest.approx(np.hypot(by_clicks, 0.01 * 0.04))


def test_an_outline_with_a_corner_off_the_map_has_no_tilted_area() -> None:
    mesh = mesh_of(lambda x, y: 0 * x)
    terrain, errors = site(mesh)
    beyond = Outline("a", "", (np.array([[-0.2, -0.2], [0.2, -0.2], [0.5, 0.2], [-0.2, 0.2]]),))
    (colony,) = measure_outlines([beyond], mesh, terrain, errors, 0.002, 0.003)
    assert colony
    assert np.isnan([colony.measured.tilted_m2, colony.standard_error.tilted_m2]).all()
    assert colony.measured.surface_m2 == pytest.approx(0.22)
    assert colony.standard_error.surface_m2 > colony.standard_error.planar_m2 / 2 > 0


def test_the_height_of_a_half_seen_mound_holds_what_was_not_seen() -> None:
    mesh = mesh_of(lambda x, y: dome(x - 0.28, y))  # its top lies at the map's edge
    terrain, errors = site(mesh)
    ring = circle(RIM_M).rings[0]
    outlines = [Outline("a", "", (ring + np.array([x_m, 0]),)) for x_m in (0.28, 0.34)]
    for colony in measure_outlines(outlines, mesh, terrain, errors, 0.002):
        assert colony and 0.4 < colony.unseen < 0.7
        assert 0.03 < colony.standard_error.height_m < 0.08
    (whole,) = measure_outlines(
        [circle(RIM_M)], mesh_of(dome), *site(mesh_of(dome)), height_std_m=0.002
    )
    assert whole and whole.standard_error.height_m < 0.01


def test_an_area_of_the_map_without_a_surface_says_why() -> None:
    ground = Ground(np.zeros((60, 60), np.float32), Grid(0.0, 0.6, CELL_M, (60, 60)), 0.002)
    corners = ((0.301, 0.301), (0.303, 0.301), (0.302, 0.303))  # between the centers of cells
    wanted = Wanted("a", "", "area", "", (), tuple((x, y, np.nan, 0.0) for x, y in corners))
    found = measured_on_map(ground, wanted, 0.0)
    assert found.value and found.surface is None and "smaller than a cell" in found.note


def test_the_known_part_of_an_outline_on_the_map_has_a_standard_error() -> None:
    """Also where its corners are exact: its edge is found to half a cell."""
    heights = np.zeros((60, 60), np.float32)
    heights[:, 30:] = np.nan
    ground = Ground(heights, Grid(0.0, 0.6, CELL_M, heights.shape), 0.002)
    part = ground.known_area([(0.1, 0.1), (0.5, 0.1), (0.5, 0.5), (0.1, 0.5)], 0.0)
    assert part and part[0].value == pytest.approx(0.08, abs=2 * part[0].std)
    assert 0 < part[0].std < 0.01


def test_the_mesh_counts_what_overhangs() -> None:
    ground = mesh_of(lambda x, y: 0 * x)
    table = ground.moved(np.block([[np.eye(3), np.array([[0], [0], [0.2]])], [np.zeros(3), 1]]))
    both = SiteMesh(
        *(
            np.concatenate([getattr(ground, n), getattr(table, n)])
            for n in ("points_m", "normals", "color")
        ),
        np.concatenate([ground.triangles, table.triangles + len(ground.points_m)]),
    )
    terrain, errors = site(both)
    (scale, *_) = structure(terrain, errors, mesh_m2=both.area_over)
    assert scale.mapped.rugosity_area == pytest.approx(1, abs=1e-9)
    # a cell at the edge is half covered
    assert scale.mapped.mesh_rugosity == pytest.approx(2, abs=0.05)


def test_what_is_unknown_is_a_dash_and_areas_have_errors() -> None:
    size, error = ColonySize(0.2, 0.2, 0.3, 0.3, 0.1, np.nan, 1.5), ColonySize(*[0.02] * 7)
    colony = Colony("T1", "table", size, error, 0.0, 3.0)
    values = Numbers(1.9156, 1.26, np.nan, 0.2, 0.18, 1.5621)
    errors = replace(values, rugosity_area=0.061, mesh_rugosity=np.nan)
    scale = StructureAtScale(0.25, 0.01, 4, values, errors, values, values)
    text = metrics_text(SiteMetrics((scale,), (colony,), (), (), 0.01, 5.0, 0.01))
    assert "2000 +- 200  3000 +- 200  10.0 +- 2.0  -" in text
    assert all(number in text for number in ("1.916(61)", " -\n", " 1.562\n")) and "nan" not in text


@pytest.mark.slow
def test_standard_errors_are_the_spread_of_repeated_surveys() -> None:
    """Surveys of one dome with errors of known size: their volumes differ by as much as each of
    them says.
    """
    rng, clean = np.random.default_rng(1), mesh_of(dome)
    found = []
    for _ in range(24):
        noisy = clean.points_m + np.array([0, 0, 0.004]) * rng.standard_normal(
            (len(clean.points_m), 1)
        )
        mesh = SiteMesh(noisy, clean.normals, clean.color, clean.triangles)
        terrain, errors = site(mesh, 0.004, correlation_m=0.0)
        (colony,) = measure_outlines([circle(RIM_M)], mesh, terrain, errors, 0.004)
        assert colony is not None
        found.append((colony.measured.volume_l, colony.standard_error.volume_l))
    volumes, said = np.array(found).T
    # the ground beneath, whose departure is read off few cells, enlarges some
    assert 0.6 < volumes.std(ddof=1) / np.median(said) < 1.6


@pytest.mark.slow
def test_a_height_is_that_of_the_coral_and_not_of_its_highest_error() -> None:
    rng, clean, rows = np.random.default_rng(2), mesh_of(dome), []
    for _ in range(12):
        noisy = clean.points_m + np.array([0, 0, 0.004]) * rng.standard_normal(
            (len(clean.points_m), 1)
        )
        mesh = SiteMesh(noisy, clean.normals, clean.color, clean.triangles)
        terrain, errors = site(mesh, 0.004, correlation_m=0.0)
        (colony,) = measure_outlines([circle(RIM_M)], mesh, terrain, errors, STD_M)
        assert colony is not None
        found, std = colony.measured.height_m, colony.standard_error.height_m
        rows.append((np.nanmax(terrain.height_m) - 0.15, found - 0.15, abs(found - 0.15) < 2 * std))
    mapped_m, off_m, held = np.mean(rows, axis=0)
    assert mapped_m > 0.004 and abs(off_m) < 0.6 * mapped_m and held > 0.7


def test_a_part_of_what_smoothing_takes_from_highest_places_is_given_back() -> None:
    """Not all: what rises beside steps, where matching lays ramps, makes up for some."""
    rng, correlation_cells = np.random.default_rng(0), 1.4
    true_m = smoothed(rng.standard_normal((240, 240)), 3.0)
    true_m *= 0.02 / true_m.std()

    def highest(heights: NDArray[np.float64]) -> NDArray[np.float64]:
        return heights.reshape(8, 30, 8, 30).max(axis=(1, 3)).ravel()

    def off_m(height_m: NDArray[np.float64]) -> float:
        found, _ = peaks(highest, height_m, np.zeros_like(height_m), correlation_cells)
        return float((found - highest(true_m)).mean())

    seen_m = smoothed(true_m, 1.3)
    lost_m = float((highest(true_m) - highest(seen_m)).mean())
    assert 0.5 * lost_m < -off_m(seen_m) < 0.85 * lost_m


@pytest.mark.slow
@pytest.mark.parametrize(("wave_m", "tall_m"), [(0.3, 0.0), (0.3, 0.02), (0.2, 0.02), (0.3, 0.04)])
def test_structure_is_that_of_the_ground_and_not_of_its_noise(wave_m: float, tall_m: float) -> None:
    """Waves, smoothed as matching does, with noise of 5 mm: what the map has is too rough by many
    of its standard errors.
    """
    rng = np.random.default_rng(3)
    x, y = np.meshgrid(*(np.arange(200) * CELL_M,) * 2)
    true_m = tall_m * np.sin(2 * np.pi * x / wave_m) * np.cos(2 * np.pi * y / wave_m)
    noise = cv2.GaussianBlur(rng.standard_normal(x.shape), (0, 0), 1.5 / np.sqrt(2))
    grid = Grid(0.0, 2.0, CELL_M, true_m.shape)
    height_m = cv2.GaussianBlur(true_m, (0, 0), 1.3) + 0.005 * noise / noise.std()
    terrain = Terrain(grid, height_m, np.full((*true_m.shape, 3), np.nan, np.float32))
    std_m = np.full(grid.shape, 0.005)
    errors = TerrainErrors(std_m, std_m, np.ones(grid.shape, np.int32), 0.015)
    (scale,) = (each for each in structure(terrain, errors) if each.edge_m == 1)
    cells = round(scale.scale_m / CELL_M)
    coarse = replace(terrain, height_m=true_m).averaged(cells)
    true = numbers_of(coarse.height_m, scale.scale_m, squares_of(coarse)[1.0]).mean(axis=0)
    for name, value in zip(vars(scale.mean), true, strict=False):
        found, std = getattr(scale.mean, name), getattr(scale.standard_error, name)
        assert abs(found - value) < 2.5 * std, name
        assert std < 0.5 * max(value, 0.05), name
    if tall_m == 0:
        assert scale.mapped.rugosity_area > 1.04 and scale.mean.rugosity_area < 1.01


def test_cover_is_of_what_was_seen_and_of_what_was_outlined() -> None:
    colonies = [
        colony("coral", 2.0, 1.0, 0.1),
        colony("coral", 4.0, 2.0, 0.1),
        colony("", 2.0, 3.0, 0.2),
    ]
    coral, sand = cover(colonies, 30.0)
    assert (coral.label, coral.outlines, coral.surface_m2, coral.of_outlined_surface) == (
        "coral",
        2,
        6,
        0.75,
    )
    assert (coral.of_seen, coral.of_outlined_planar) == (0.1, 0.5)
    assert (sand.label, sand.of_seen, sand.of_outlined_surface) == ("unlabeled", 0.1, 0.25)
    # of a / (a + b) with a = 6 +- 0.1 sqrt 2, b = 2 +- 0.2
    assert coral.of_outlined_surface_std == pytest.approx(
        np.hypot(2 * 0.1 * np.sqrt(2), 6 * 0.2) / 64
    )
    assert sand.of_outlined_surface_std == pytest.approx(coral.of_outlined_surface_std)


def half_seen(height: Callable[[Array, Array], Array]) -> SiteMesh:
    """A surface of which the part beyond x = 0 was not seen."""
    mesh = mesh_of(height)
    seen = (mesh.points_m[mesh.triangles][:, :, 0] <= 1e-9).all(axis=1)
    return SiteMesh(mesh.points_m, mesh.normals, mesh.color, mesh.triangles[seen])


@pytest.mark.slow
def test_what_was_not_seen_of_an_outline_is_in_its_standard_errors() -> None:
    """A dome shifted to the seen side: the rest is flat, which the half that was seen does not
    tell.
    """

    def beside(x: Array, y: Array) -> Array:
        return dome(x + 0.05, y, 0.1)

    true, seen = mesh_of(beside), half_seen(beside)
    truth, found = (
        measure_outlines([circle(RIM_M)], mesh, *site(mesh), STD_M)[0] for mesh in (true, seen)
    )
    assert truth is not None and found is not None
    assert found.unseen == pytest.approx(0.5, abs=0.05)
    for name in ("surface_m2", "volume_l"):
        error, std = (
            abs(vars(found.measured)[name] - vars(truth.measured)[name]),
            vars(found.standard_error)[name],
        )
        assert error < 2.5 * std, name
        assert std > 3 * vars(truth.standard_error)[name], name
    flat = half_seen(lambda x, y: 0 * x)
    (level,) = measure_outlines([circle(RIM_M)], flat, *site(flat), STD_M)
    assert level is not None and level.standard_error.surface_m2 < 0.2 * level.measured.surface_m2


def test_the_part_of_an_outline_beyond_the_map_is_unseen_and_does_not_cover_the_bottom() -> None:
    mesh = mesh_of(lambda x, y: 0 * x)
    seen_m2, outlined_m2 = 0.6**2, np.pi * 1.5**2
    (found,) = measure_outlines([circle(1.5)], mesh, *site(mesh), STD_M)
    assert found is not None
    assert found.unseen == pytest.approx(1 - seen_m2 / outlined_m2, rel=0.02)
    assert cover([found], seen_m2)[0].of_seen == pytest.approx(1.0, rel=0.05)


@pytest.mark.slow
def test_outlines_that_overlap_count_what_they_share_once() -> None:
    mesh = mesh_of(lambda x, y: 0 * x)
    outlines = [circle(RIM_M, name, "coral") for name in "ab"]
    twice = [each for each in measure_outlines(outlines, mesh, *site(mesh), STD_M) if each]
    assert cover(twice, 1.0)[0].surface_m2 == pytest.approx(twice[0].measured.surface_m2)
    inner = [
        each
        for each in measure_outlines(
            [circle(RIM_M, "", "rock"), circle(0.1, "", "coral")], mesh, *site(mesh), STD_M
        )
        if each
    ]
    # in whole cells
    assert sum(each.planar_m2 for each in cover(inner, 1.0)) == pytest.approx(
        inner[0].measured.planar_m2, rel=0.01
    )


def colony(label: str, surface_m2: float, planar_m2: float, std_m2: float) -> Colony:
    nothing = float("nan")
    error = ColonySize(0, 0, std_m2, nothing, nothing, nothing, nothing)
    return Colony(
        "",
        label,
        ColonySize(planar_m2, planar_m2, surface_m2, nothing, nothing, nothing, nothing),
        error,
        0,
        3,
    )


def test_an_outline_with_a_hole_covers_the_cells_whose_centers_it_holds() -> None:
    grid = Grid(0.0, 1.0, 0.1, (10, 10))
    outer, inner = (
        np.array([[0.04, 0.04], [0.96, 0.04], [0.96, 0.96], [0.04, 0.96]]),
        np.array([[0.3, 0.3], [0.6, 0.3], [0.6, 0.6], [0.3, 0.6]]),
    )
    mask = Outline("", "", (outer, inner)).mask(grid)
    expected = np.ones((10, 10), bool)
    expected[4:7, 3:6] = False
    assert (mask == expected).all()
    assert not Outline("", "", (outer + 0.02,)).mask(grid)[:, 0].any()


@pytest.fixture(scope="module")
def fused(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A flat bottom at z = 0, seen from 1.5 m by five frames 0.3 m apart."""
    return write_map(tmp_path_factory.mktemp("run") / "out", flat_frames(5))


@pytest.mark.slow
@pytest.mark.parametrize("folder", ["range", "mask"])
def test_metrics_without_a_frame_of_the_map_are_refused(
    fused: Path, tmp_path: Path, folder: str
) -> None:
    """Heights whose noise is not known would be taken for rough ground."""
    out = shutil.copytree(fused, tmp_path / "out")
    gone = sorted((out / folder).iterdir())[2]
    gone.unlink()
    with pytest.raises(InputError, match=f"{re.escape(str(gone))}: is missing or damaged"):
        metrics(out)


@pytest.mark.slow
def test_terrain_is_surer_where_more_frames_saw_it(fused: Path) -> None:
    posed, mesh = open_posed_run(fused), read_mesh(fused)
    terrain = terrain_of(mesh, grid_of(mesh, 0.02))
    errors = terrain_errors(posed, terrain)
    assert errors.views.max() >= 3
    once, often = errors.views == 1, errors.views == 3
    # straight below; further out the range and its error grow, and the ray leans
    single_m = 0.004 * 1.5**2
    assert np.nanmin(errors.std_m[once]) == pytest.approx(single_m, rel=0.2)
    assert np.nanmedian(errors.std_m[often]) == pytest.approx(single_m / np.sqrt(3), rel=0.25)
    assert np.isnan(errors.std_m[errors.views == 0]).all()


def write_geojson(path: Path, rings: dict[str, list[list[float]]], **members: object) -> Path:
    features = [
        {
            "type": "Feature",
            "properties": {"Label": label},
            "geometry": {"type": "Polygon", "coordinates": [[*ring, ring[0]]]},
        }
        for label, ring in rings.items()
    ]
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features, **members}))
    return path


SQUARE = [[0.2, -0.2], [0.6, -0.2], [0.6, 0.2], [0.2, 0.2]]


@pytest.mark.slow
def test_metrics_of_a_run_with_outlines(
    fused: Path, tmp_path: Path, cli: Callable[..., tuple[int, str, str]]
) -> None:
    far = [[x + 50, y] for x, y in SQUARE]
    polygons = write_geojson(tmp_path / "p.geojson", {"coral": SQUARE, "far": far})
    code, said, _ = cli(
        "metrics", fused, "--polygons", polygons, "--out", tmp_path / "to", "--json"
    )
    result = json.loads(said)
    assert mismatch(result, SHAPES["metrics"]) is None
    assert (code, result["unseen"]) == (3, ["2"])
    (coral,) = result["colonies"]
    assert coral["measured"]["planar_m2"] == pytest.approx(0.16, rel=0.06)
    assert coral["measured"]["rugosity"] == pytest.approx(1, abs=0.02)
    with (tmp_path / "to/structure.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert (
        float(rows[0]["rugosity_area"]) == pytest.approx(1, abs=0.01)
        and float(rows[0]["rugosity_area_std"]) > 0
    )
    assert sorted(path.name for path in (tmp_path / "to").iterdir()) == [
        "cover.csv",
        "outlines.csv",
        "structure.csv",
    ]
    code, said, _ = cli("metrics", fused, "--polygons", polygons)
    assert "not seen, or smaller than a cell: 2" in said and "coral" in said
    write_geojson(polygons, {"far": far})
    with pytest.raises(InputError, match=r"no outline lies on the map: they have x 50.2 to 50.6"):
        metrics(fused, polygons)
    with pytest.raises(OutputError):
        metrics(fused, None, tmp_path / "to")


def georeferenced(fused: Path) -> PosedRun:
    posed = open_posed_run(fused)
    return replace(
        posed, map=replace(posed.map, offset_m=[100.0, 200, 0], origin=GeoOrigin(-18.5, 147.2))
    )


def test_geojson_in_meters_degrees_or_a_named_system_is_the_same_outline(
    fused: Path, tmp_path: Path
) -> None:
    import pyproj

    posed = georeferenced(fused)
    world = [[x + 100, y + 200] for x, y in SQUARE]
    degrees = [list(degrees_from_north_east(y, x, posed.origin))[::-1] for x, y in world]
    utm = pyproj.Transformer.from_crs("OGC:CRS84", "EPSG:32755", always_xy=True)
    files = [
        write_geojson(tmp_path / "m.json", {"a": world}),
        write_geojson(tmp_path / "d.json", {"a": degrees}),
        write_geojson(
            tmp_path / "u.json",
            {"a": [list(utm.transform(*place)) for place in degrees]},
            crs={"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::32755"}},
        ),
    ]
    for file in files:
        (outline,) = read_outlines(file, posed)
        np.testing.assert_allclose(outline.rings[0][:4], SQUARE, atol=2e-3)
        assert (outline.name, outline.label) == ("1", "a")


def test_degrees_without_a_system_are_recognized_across_the_antimeridian(
    fused: Path, tmp_path: Path
) -> None:
    posed = georeferenced(fused)
    posed = replace(posed, map=replace(posed.map, origin=GeoOrigin(-18.5, 179.9999)))
    degrees = [
        list(degrees_from_north_east(y + 200, x + 100, posed.origin))[::-1] for x, y in SQUARE
    ]
    assert all(longitude < -179 for longitude, _ in degrees)
    (outline,) = read_outlines(write_geojson(tmp_path / "d.json", {"a": degrees}), posed)
    np.testing.assert_allclose(outline.rings[0][:4], SQUARE, atol=2e-3)


def test_no_polygon_of_a_collection_is_lost_and_labels_of_taglab_and_arcgis_are_read(
    fused: Path, tmp_path: Path
) -> None:
    square = {"type": "Polygon", "coordinates": [[*SQUARE, SQUARE[0]]]}
    empty: dict[str, object] = {"type": "Polygon", "coordinates": []}  # as QGIS may write it
    given = [
        (
            {"TL_id": 5, "TL_Class": "Porites"},
            {"type": "GeometryCollection", "geometries": [square]},
        ),
        ({"OBJECTID": 6, "Classname": "sand"}, square),
        ({"OBJECTID": 7, "Classname": "sand"}, empty),
    ]
    features = [{"type": "Feature", "properties": p, "geometry": g} for p, g in given]
    file = tmp_path / "c.json"
    file.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    found = read_outlines(file, open_posed_run(fused))
    assert [(each.name, each.label) for each in found] == [("5", "Porites"), ("6", "sand")]


def test_a_taglab_project_is_in_pixels_of_the_orthomosaic(fused: Path, tmp_path: Path) -> None:
    import rasterio

    with rasterio.open(fused / "map/orthomosaic.tif") as file:
        west, north, cell_m, size = (
            file.bounds.left,
            file.bounds.top,
            file.res[0],
            (file.width, file.height),
        )
    contour = [[(x - west) / cell_m - 0.5, (north - y) / cell_m - 0.5] for x, y in SQUARE]
    region = {"id": 7, "class name": "Pocillopora", "contour": contour, "inner contours": []}
    image = {"width": size[0], "height": size[1], "annotations": {"regions": [region]}}
    project = tmp_path / "project.json"
    project.write_text(json.dumps({"images": [image]}))
    (outline,) = read_outlines(project, open_posed_run(fused))
    np.testing.assert_allclose(outline.rings[0], SQUARE, atol=1e-9)
    assert (outline.name, outline.label) == ("7", "Pocillopora")
    steps = np.diff(np.rint(np.array(contour) * 10).astype(int), axis=0, prepend=0).ravel()
    text = " ".join(map(str, steps))  # tenths of a pixel, each corner from the one before
    region |= {"contour": text, "inner contours": [text]}
    for regions in ({"regions": [region], "points": []}, [region]):  # now, and in older projects
        project.write_text(json.dumps({"images": [{**image, "annotations": regions}]}))
        (outline,) = read_outlines(project, open_posed_run(fused))
        assert len(outline.rings) == 2
        np.testing.assert_allclose(outline.rings[0], SQUARE, atol=0.1 * cell_m)
        np.testing.assert_allclose(outline.rings[1], SQUARE, atol=0.1 * cell_m)
    project.write_text(json.dumps({"images": [{**image, "width": 3}]}))
    with pytest.raises(InputError, match=r"no image of .* px, the size of orthomosaic.tif"):
        read_outlines(project, open_posed_run(fused))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", r"is neither GeoJSON nor .*: save the polygons as GeoJSON$"),
        ('{"type": "FeatureCollection", "features": []}', "holds no polygon"),
        ('{"features": 3}', r"is damaged, or in an unknown .*: save the polygons as GeoJSON$"),
        (
            '{"type": "LineString", "coordinates": [[0, 0], [1, 0], [1, 1], [0, 0]]}',
            "feature 1 is a line: make it a polygon, or leave it out",
        ),
        (
            '{"type": "Feature", "geometry": {"type": "Point", "coordinates": [1, 2]}}',
            "holds no polygon",
        ),
    ],
)
def test_files_without_outlines_say_so(
    fused: Path, tmp_path: Path, content: str, message: str
) -> None:
    (tmp_path / "p.json").write_text(content)
    with pytest.raises(InputError, match=message):
        read_outlines(tmp_path / "p.json", open_posed_run(fused))


@pytest.mark.slow
def test_page_methods_metrics_mosaic_and_terrain_state_one_area_and_one_rugosity(
    sample_run: SampleRun,
) -> None:
    made = open_map(sample_run.out)
    assert made is not None and made.area_m2
    with rasterio.open(made.folder / "dem.tif") as file:
        assert np.isfinite(file.read(1)).sum() * file.res[0] ** 2 == pytest.approx(made.area_m2)
    with rasterio.open(made.folder / "orthomosaic.tif") as file:
        # edges, in other cells
        assert (file.read(4) > 0).sum() * file.res[0] ** 2 == pytest.approx(made.area_m2, rel=0.005)
    found = metrics(sample_run.out)
    assert found.area_m2 == pytest.approx(made.area_m2)
    facts = DiveFacts.of(open_run(sample_run.out))
    (scale,) = (each for each in found.structure if each.edge_m == 1)
    assert facts.structure is not None
    assert facts.structure.mean.rugosity_area == pytest.approx(scale.mean.rugosity_area, rel=1e-3)
    rugosity = f"{scale.mean.rugosity_area:.2f} ± {scale.standard_error.rugosity_area:.2f}"
    assert f"{rugosity} (standard error)" in methods(facts)
    assert any(fact.value.startswith(rugosity) for fact in dive_facts(facts))
    white = re.search(r"\(standard error of red over green .*?\)", methods(facts))
    assert white and facts.water and white[0] in white_doubt(facts.water)
    said = digits(made.area_m2)
    assert f"{said} m² of reef" in methods(facts)
    assert phrase("unit.m2", value=said) in {fact.value for fact in dive_facts(facts)}
    lacking = replace(facts, map=replace(made, missing_fraction=0.68))
    assert any("lacks 68% of the measured ground" in reason for reason in judge(lacking).reasons)
    assert made.missing_fraction < 0.05 and not any("lacks" in why for why in judge(facts).reasons)
