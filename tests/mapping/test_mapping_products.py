"""What is made of a map: terrain, mosaic, metrics, preview, and files that geographic programs
open.
"""

from dataclasses import replace
from pathlib import Path

import laspy
import numpy as np
import pyproj
import pytest
import rasterio
import tifffile
from mapping_scene import CONFIG, PAIR, flat_frame, track
from PIL import Image

from stereo_seecolor.mapping.raster import mosaic
from stereo_seecolor.mapping.raster.block_raster import BlockRaster
from stereo_seecolor.mapping.raster.georeference import Georeference, write_geotiff
from stereo_seecolor.mapping.raster.grid import Grid
from stereo_seecolor.mapping.raster.preview import render_preview
from stereo_seecolor.mapping.raster.reef_metrics import measure, measure_squares, site_of
from stereo_seecolor.mapping.raster.terrain import render_terrain
from stereo_seecolor.mapping.surface.surface import Surface
from stereo_seecolor.mapping.survey_map import build_map
from stereo_seecolor.records import GeoOrigin, Trajectory

CELL_M = 0.01


def ramp(rise_east: float, rise_north: float, size: int = 100) -> np.ndarray:
    row, column = np.mgrid[:size, :size]
    return (column * rise_east - row * rise_north) * CELL_M


def test_flat_ground_is_one_everywhere() -> None:
    metrics = measure(np.zeros((100, 100)), CELL_M)
    assert metrics.surface_rugosity == pytest.approx(1)
    assert metrics.linear_rugosity == 1
    assert metrics.slope_deg == metrics.vector_ruggedness == pytest.approx(0, abs=1e-9)
    assert metrics.fractal_dimension == pytest.approx(2)
    assert metrics.height_range_m == pytest.approx(0, abs=1e-9)


def test_a_ramp_has_its_slope_and_faces_downhill() -> None:
    metrics = measure(ramp(1.0, 0.0), CELL_M)  # rises to the east by 45 degrees: faces west
    assert metrics.slope_deg == pytest.approx(45)
    assert metrics.aspect_deg == pytest.approx(270)
    assert metrics.surface_rugosity == pytest.approx(np.sqrt(2))
    assert metrics.linear_rugosity == pytest.approx((np.sqrt(2) + 1) / 2)
    assert metrics.vector_ruggedness == pytest.approx(0, abs=1e-9)
    assert metrics.height_range_m == pytest.approx(0, abs=1e-9)
    assert measure(ramp(0.0, 1.0), CELL_M).aspect_deg == pytest.approx(180)


def test_a_sine_has_the_arc_length_of_a_sine() -> None:
    x = np.arange(400) * CELL_M
    heights = np.broadcast_to(0.1 * np.sin(2 * np.pi * x / 1.0), (400, 400))
    fine = np.linspace(0, 4, 400001)
    arc = np.hypot(np.diff(fine), np.diff(0.1 * np.sin(2 * np.pi * fine))).sum() / 4
    assert measure(heights, CELL_M).surface_rugosity == pytest.approx(arc, rel=1e-3)
    assert measure(heights, CELL_M).linear_rugosity == pytest.approx((arc + 1) / 2, rel=1e-3)


def test_rough_ground_has_a_higher_dimension() -> None:
    rough = np.random.default_rng(0).normal(0, 0.05, (128, 128))
    assert measure(rough, CELL_M).fractal_dimension > 2.3
    assert measure(rough, CELL_M).vector_ruggedness > 0.2


def test_squares_exist_only_where_something_was_seen(tmp_path: Path) -> None:
    # 2 by 3 km: as one array it would take 240 GB
    grid = Grid(0.0, 2000.0, CELL_M, (200_000, 300_000))
    terrain = BlockRaster(tmp_path / "terrain", grid, 1, np.float32, np.nan)
    terrain.write(slice(150_000, 150_200), slice(100_000, 100_100), np.zeros((1, 200, 100)))
    squares = measure_squares(terrain, 1.0, tmp_path / "squares")
    block = squares.read(slice(1500, 1503), slice(1000, 1002))
    assert np.isfinite(block[1]).tolist() == [[True, False], [True, False], [False, False]]
    site = site_of(block[:, :2, :1].reshape(len(block), -1))
    assert (site[0], site[1]) == (1, pytest.approx(1))


def test_windows_of_a_block_raster_round_trip(tmp_path: Path) -> None:
    raster = BlockRaster(tmp_path, Grid(0.0, 0.0, 1.0, (1000, 1300)), 2, np.float32, -1)
    values = np.random.default_rng(0).normal(size=(2, 600, 700)).astype(np.float32)
    raster.write(slice(300, 900), slice(400, 1100), values)
    np.testing.assert_array_equal(raster.read(slice(300, 900), slice(400, 1100)), values)
    around = raster.read(slice(-5, 310), slice(390, 410))
    np.testing.assert_array_equal(around[:, 305:, 10:], values[:, :10, :10])
    assert (around[:, :305] == -1).all()
    assert len(list(raster.windows())) == 6


def test_cells_are_centered_on_voxels_and_cover_the_box() -> None:
    grid = Grid.around(np.array([-0.504, 0.01]), np.array([1.0, 0.497]), CELL_M)
    x, y = grid.centers(slice(0, grid.shape[0]), slice(0, grid.shape[1]))
    for centers, low, high in ((x, -0.504, 1.0), (y, 0.01, 0.497)):
        np.testing.assert_allclose(centers / CELL_M, np.rint(centers / CELL_M), atol=1e-6)
        assert centers.min() - CELL_M / 2 <= low < centers.min() + CELL_M / 2
        assert centers.max() - CELL_M / 2 < high <= centers.max() + CELL_M / 2


def pyramid() -> Surface:
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0.5, 1]], np.float32)
    triangles = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]], np.int32)
    up = np.broadcast_to(np.float32([0, 0, 1]), points.shape)
    return Surface(points, up, np.full((5, 3), (10, 200, 30), np.uint8), triangles)


@pytest.mark.slow
def test_terrain_is_the_highest_surface_over_each_cell(tmp_path: Path) -> None:
    grid = Grid.around(np.array([-0.5, 0.0]), np.array([1.0, 1.0]), 0.1)
    roof = pyramid()
    floor = Surface(
        roof.points_m * np.float32([1, 1, 0]), roof.normals, roof.colors, roof.triangles
    )
    terrain = render_terrain([roof, floor], grid, tmp_path).read(slice(0, 10), slice(0, 15))[0]
    assert np.isnan(terrain[:, :5]).all()
    x, y = grid.centers(slice(0, 10), slice(5, 15))
    np.testing.assert_allclose(
        terrain[:, 5:], 1 - 2 * np.maximum(abs(x - 0.5), abs(y - 0.5)), atol=1e-6
    )


def test_vertices_on_cells_centers_leave_no_slits(tmp_path: Path) -> None:
    """As the map's are, far from the origin in float32; a strip one voxel wide is two cells."""
    x, y = np.meshgrid(np.arange(2000, 2041), np.arange(3000, 3002))
    points = np.stack([x * 0.01, y * 0.01, 0 * x], axis=-1).reshape(-1, 3) + np.random.default_rng(
        0
    ).normal(0, 2e-6, (82, 3))
    corner = np.arange(40)
    lower, upper = (
        np.stack([corner, corner + 1, corner + 41], -1),
        np.stack([corner + 1, corner + 42, corner + 41], -1),
    )
    triangles = np.concatenate([lower, upper]).astype(np.int32)
    strip = Surface(
        points.astype(np.float32),
        np.zeros((82, 3), np.float32),
        np.zeros((82, 3), np.uint8),
        triangles,
    )
    grid = Grid(19.995, 30.015, 0.01, (2, 41))
    assert np.isfinite(
        render_terrain([strip], grid, tmp_path).read(slice(0, 2), slice(0, 41))
    ).all()


@pytest.mark.slow
def test_the_preview_shows_the_map_on_white() -> None:
    image = render_preview(lambda: [pyramid()])
    assert max(image.shape) == pytest.approx(1600, abs=4)
    assert (image[0, 0] == 255).all()
    middle = image[image.shape[0] // 2, image.shape[1] // 2].astype(int)
    assert middle.argmax() == 1
    assert (render_preview(lambda: []) == 255).all()


def georeferenced(count: int) -> Trajectory:
    plain = track(count)
    return Trajectory(
        plain.names, plain.timestamps_s, plain.T_world_camera, origin=GeoOrigin(-23.5, 152.0)
    )


@pytest.mark.slow
def test_geographic_files_lie_where_the_survey_was(tmp_path: Path) -> None:
    summary = build_map([flat_frame(i) for i in range(4)], PAIR, tmp_path, CONFIG, georeferenced(4))
    assert {path.name for path in summary.files} >= {
        "dem.tif",
        "orthomosaic.tif",
        "reef_metrics.tif",
        "cloud.laz",
    }
    with rasterio.open(tmp_path / "dem.tif") as dem:
        heights, crs = dem.read(1), dem.crs
        assert dem.res == (CONFIG.dem_m, CONFIG.dem_m)
        assert dem.bounds.left == pytest.approx(-0.6, abs=0.05)
        assert np.nanmax(np.abs(heights)) < 0.001
        longitude, latitude = pyproj.Transformer.from_crs(
            crs.to_wkt(), 4326, always_xy=True
        ).transform(0.0, 0.0)
    assert (latitude, longitude) == pytest.approx((-23.5, 152.0), abs=1e-9)
    with laspy.open(tmp_path / "cloud.laz") as file:
        # one system in all
        assert pyproj.CRS.from_wkt(crs.to_wkt()).equals(file.header.parse_crs())
    for name in ("cloud.ply", "mesh.ply"):
        assert (
            b"comment crs transverse Mercator around latitude -23.5"
            in (tmp_path / name).read_bytes()[:500]
        )
    cloud = laspy.read(tmp_path / "cloud.laz")
    assert np.max(cloud.x) - np.min(cloud.x) == pytest.approx(
        dem.bounds.right - dem.bounds.left, abs=0.05
    )
    assert len(cloud.points) == summary.points
    degrees = pyproj.Transformer.from_crs(cloud.header.parse_crs(), 4326, always_xy=True).transform(
        np.mean(cloud.x), np.mean(cloud.y)
    )
    assert degrees == pytest.approx((152.0, -23.5), abs=2e-5)
    assert (int(cloud.red[0]), int(cloud.green[0])) == (200 * 257, 120 * 257)


@pytest.mark.slow
def test_the_mosaic_is_painted_where_something_was_seen(tmp_path: Path) -> None:
    frames = [flat_frame(i, fish=i == 1) for i in range(4)]
    build_map(frames, PAIR, tmp_path, CONFIG, track(4, step_m=0.15))
    with rasterio.open(tmp_path / "orthomosaic.tif") as file:
        rgba = file.read()
        assert file.colorinterp[3].name == "alpha"
        assert file.profile["tiled"]
        assert pyproj.CRS.from_wkt(file.crs.to_wkt()).type_name == "Engineering CRS"
        assert 'UNIT["metre",1' in file.crs.to_wkt()
    painted = rgba[3] == 255
    assert painted.mean() > 0.9
    np.testing.assert_array_equal(np.unique(rgba[:3, painted], axis=1).ravel(), [200, 120, 40])
    assert (rgba[:3, ~painted] == 0).all()


@pytest.mark.slow
def test_the_mosaic_has_the_mean_color_of_all_views_and_no_step_between_them(
    tmp_path: Path,
) -> None:
    bright, dim = (200, 120, 40), (160, 96, 32)
    frames = [flat_frame(i, color=dim if i % 2 else bright) for i in range(8)]
    build_map(frames, PAIR, tmp_path, CONFIG, track(8, step_m=0.1))
    with rasterio.open(tmp_path / "orthomosaic.tif") as file:
        red = file.read(1).astype(int)
    rows, columns = (size // 2 for size in red.shape)
    # seen by as many bright frames as dim ones
    middle = red[rows - 10 : rows + 10, columns - 20 : columns + 20]
    assert np.abs(middle - 180).max() <= 6
    assert np.abs(np.diff(middle, axis=1)).max() <= 2


def test_the_mosaic_is_painted_up_to_both_sides_of_a_step_of_the_terrain(tmp_path: Path) -> None:
    """A wall of half a meter right under the camera, which sees both the ground before it and the
    ground on top.
    """
    terrain = BlockRaster(tmp_path, Grid(-0.41, 0.41, 0.02, (41, 41)), 1, np.float32, np.nan)
    heights = np.where(np.arange(41) < 20, 0.0, 0.5) * np.ones((1, 41, 1))
    terrain.write(slice(0, 41), slice(0, 41), heights.astype(np.float32))
    cells = mosaic._cells(
        terrain, Grid(-0.2025, 0.2025, 0.005, (81, 81)), slice(0, 81), slice(0, 81)
    )
    # between the last low cell's center and the first high one's: the wall stands there
    edge_m = -0.01
    T = np.diag([1.0, -1, -1, 1])
    T[:3, 3] = edge_m, 0, 1.5
    before, on_top = (200, 120, 40), (40, 120, 200)
    is_before = np.arange(160) < 80
    color = np.broadcast_to(
        np.where(is_before[:, None], before, on_top).astype(np.uint8), (128, 160, 3)
    ).copy()
    range_m = np.where(is_before, 1.5, 1.0).astype(np.float32) * PAIR.ray_length
    rgba = mosaic._paint(
        cells, [(mosaic._Sight(color, range_m, np.zeros((128, 160), np.bool_)), T)], PAIR
    )
    assert (rgba[3] == 255).all()
    # a pixel of the frame is 7 mm wide
    low, high = (cells.x_m < edge_m - 0.01, cells.x_m > edge_m + 0.01)
    np.testing.assert_array_equal(
        np.unique(rgba[:3][:, :, low].reshape(3, -1), axis=1).ravel(), before
    )
    np.testing.assert_array_equal(
        np.unique(rgba[:3][:, :, high].reshape(3, -1), axis=1).ravel(), on_top
    )


def test_the_edge_of_a_step_runs_across_the_cells_of_the_terrain(tmp_path: Path) -> None:
    terrain = BlockRaster(tmp_path, Grid(-0.41, 0.41, 0.02, (41, 41)), 1, np.float32, np.nan)

    def on_top(x_m: np.ndarray, y_m: np.ndarray) -> np.ndarray:
        return x_m + 0.6 * y_m[:, None] > 0

    heights = np.where(on_top(*terrain.grid.axes(slice(0, 41), slice(0, 41))), 0.5, 0.1)
    terrain.write(slice(0, 41), slice(0, 41), heights[None].astype(np.float32))
    cells = mosaic._cells(
        terrain, Grid(-0.2025, 0.2025, 0.005, (81, 81)), slice(0, 81), slice(0, 81)
    )
    assert set(np.unique(cells.z_m.round(6))) == {0.1, 0.5}  # nothing stands between both sides
    wrong = (cells.z_m > 0.3) != on_top(cells.x_m, cells.y_m)
    assert wrong.mean() < 0.012  # along the borders of the cells it is 0.0146
    assert np.isfinite(cells.other_m[wrong]).all()  # there a view may find the other height


def test_a_cell_without_a_height_is_painted_where_a_view_measured_its_neighbors_height(
    tmp_path: Path,
) -> None:
    terrain = BlockRaster(tmp_path, Grid(-0.41, 0.41, 0.02, (41, 41)), 1, np.float32, np.nan)
    heights = np.zeros((1, 41, 41), np.float32)
    heights[0, 18, 18] = heights[0, 22, 22] = np.nan
    heights[0, 26:, 26:] = np.nan
    terrain.write(slice(0, 41), slice(0, 41), heights)
    grid = Grid(-0.405, 0.405, 0.01, (81, 81))
    cells = mosaic._cells(terrain, grid, slice(0, 81), slice(0, 81))
    T = np.diag([1.0, -1, -1, 1])
    T[2, 3] = 1.5
    range_m = np.full((128, 160), 1.5, np.float32) * PAIR.ray_length
    down, right = (round(PAIR.focal_px * 0.04 / 1.5 + c) for c in (PAIR.cy_px, PAIR.cx_left_px))
    # what the frame shows of cell (22, 22) lies in a crack
    range_m[down - 1 : down + 2, right - 1 : right + 2] += 0.3
    sight = mosaic._Sight(
        np.full((128, 160, 3), 90, np.uint8), range_m, np.zeros((128, 160), np.bool_)
    )
    painted = mosaic._paint(cells, [(sight, T)], PAIR)[3] > 0
    assert painted[36, 36] and not painted[44, 44] and not painted[60:, 60:].any()


@pytest.mark.slow
def test_what_the_views_nearest_to_a_block_do_not_see_is_painted_from_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mosaic, "SETTINGS", replace(mosaic.SETTINGS, views_a_meter=1))
    build_map(
        [flat_frame(i) for i in range(6)],
        PAIR,
        tmp_path,
        CONFIG.model_copy(update={"mosaic_m": 0.01}),
        track(6, step_m=0.6),
    )
    with (
        rasterio.open(tmp_path / "orthomosaic.tif") as painted,
        rasterio.open(tmp_path / "dem.tif") as terrain,
    ):
        heights = terrain.read(1)
        known_m2 = np.isfinite(heights).sum() * terrain.res[0] ** 2
        assert (painted.read(4) == 255).sum() * painted.res[0] ** 2 > 0.97 * known_m2


@pytest.mark.slow
@pytest.mark.parametrize("kind", [np.float32, np.uint8])
def test_rasters_with_blocks_without_a_surface_open_in_programs_that_know_no_gdal(
    tmp_path: Path, kind: type
) -> None:
    bands, empty = (1, np.nan) if kind == np.float32 else (4, 0)
    raster = BlockRaster(tmp_path / "blocks", Grid(0.0, 8.0, 0.01, (800, 900)), bands, kind, empty)
    seen = np.random.default_rng(1).integers(1, 255, (bands, 200, 300)).astype(kind)
    raster.write(slice(500, 700), slice(400, 700), seen)
    expected = np.full((bands, 800, 900), empty, kind)
    expected[:, 500:700, 400:700] = seen

    path = write_geotiff(tmp_path / "raster.tif", raster, Georeference(np.zeros(3), None))

    with Image.open(path) as image:
        by_pillow = np.asarray(image)
    for pixels in (tifffile.imread(path), by_pillow):
        np.testing.assert_array_equal(np.moveaxis(np.atleast_3d(pixels), -1, 0), expected)


@pytest.mark.slow
def test_the_metrics_table_has_the_site_first(tmp_path: Path) -> None:
    build_map([flat_frame(i) for i in range(4)], PAIR, tmp_path, CONFIG, track(4))
    lines = (tmp_path / "reef_metrics.csv").read_text().splitlines()
    assert lines[0].startswith("square,x_m,y_m,coverage,surface_rugosity,linear_rugosity,slope_deg")
    assert lines[1].startswith("site,,,")
    assert float(lines[1].split(",")[4]) == pytest.approx(1, abs=1e-4)
    assert len(lines) > 4
