"""Settings and coordinates at the edge of what can be held: refused with the number, or right."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from mapping_scene import CONFIG, PAIR, ReefFrames, flat_frame, read_cloud, track
from track_scenes import with_noisy_disparities

from stereo_seecolor.config import MappingConfig
from stereo_seecolor.config.file import load_config
from stereo_seecolor.errors import ConfigError, MappingError
from stereo_seecolor.extras.synthetic.survey import SurveySpec
from stereo_seecolor.mapping import limits
from stereo_seecolor.mapping.component import Component
from stereo_seecolor.mapping.frame_index import SAMPLING, FrameIndex, PointSampling
from stereo_seecolor.mapping.sizes import with_mosaic_cell, with_voxel
from stereo_seecolor.mapping.surface.extraction import MIN_WEIGHT
from stereo_seecolor.mapping.surface.surface import Surface
from stereo_seecolor.mapping.surface.tiles import Tiling, cut
from stereo_seecolor.mapping.survey import Placement, Survey
from stereo_seecolor.mapping.survey_frames import Unplaced
from stereo_seecolor.mapping.survey_map import MapSummary, Workspace, build_map
from stereo_seecolor.mapping.track import loops
from stereo_seecolor.records import Trajectory


def build(folder: Path, trajectory: Trajectory | None = None, **settings: Any) -> MapSummary:
    config = CONFIG.model_copy(update=settings)
    return build_map(
        [flat_frame(i) for i in range(4)], PAIR, folder, config, trajectory or track(4)
    )


def moved(offset_m: tuple[float, float, float]) -> Trajectory:
    trajectory = track(4)
    trajectory.T_world_camera[:, :3, 3] += offset_m
    return trajectory


@pytest.mark.slow
def test_utm_coordinates_give_the_same_map_with_its_offset_stated(tmp_path: Path) -> None:
    offset = (500_000.0, 8_000_000.0, 0.0)
    build(tmp_path / "near")
    build(tmp_path / "far", moved(offset))
    near, far = (read_cloud(tmp_path / name / "cloud.ply") for name in ("near", "far"))
    np.testing.assert_array_equal(near["position"], far["position"])
    np.testing.assert_array_equal(near["color"], far["color"])
    for name in ("cloud.ply", "mesh.ply"):
        head = (tmp_path / "far" / name).read_bytes().split(b"end_header")[0].decode()
        assert "comment offset 500000.000 8000000.000 0.000" in head
    assert json.loads((tmp_path / "far" / "map.json").read_text())["offset_m"] == list(offset)
    with (
        rasterio.open(tmp_path / "near" / "dem.tif") as a,
        rasterio.open(tmp_path / "far" / "dem.tif") as b,
    ):
        np.testing.assert_array_equal(a.read(1), b.read(1))
        assert b.bounds.left - a.bounds.left == pytest.approx(offset[0], abs=1e-6)
        assert b.bounds.top - a.bounds.top == pytest.approx(offset[1], abs=1e-6)
    rows = [
        (tmp_path / name / "reef_metrics.csv").read_text().splitlines()[2].split(",")
        for name in ("near", "far")
    ]
    assert float(rows[1][2]) - float(rows[0][2]) == pytest.approx(offset[1], abs=1e-3)
    written = (tmp_path / "far" / "trajectory.tum").read_text().splitlines()[2].split()
    assert [float(value) for value in written[1:4]] == pytest.approx([500_000, 8_000_000, 1.5])


@pytest.mark.parametrize("depth_m", [80.0, 2000.0])
def test_heights_of_the_terrain_are_the_worlds_in_utm(tmp_path: Path, depth_m: float) -> None:
    """As they are where depths need no offset; else the file's band names it."""
    build(tmp_path, moved((500_000.0, 8_000_000.0, -depth_m)))
    offset_m = json.loads((tmp_path / "map.json").read_text())["offset_m"]
    assert offset_m[2] == (0.0 if depth_m < 1000 else -depth_m)
    with rasterio.open(tmp_path / "dem.tif") as file:
        heights_m = file.read(1) + file.offsets[0]
    assert np.nanmedian(heights_m) == pytest.approx(-depth_m, abs=0.02)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (
            {"voxel_m": 1e-6},
            r"voxel_m=1e-06: a pixel of these images covers 7.* mm .* set it to at least 0.0009",
        ),
        ({"voxel_m": 100.0}, r"voxel_m=100: the scene is 1.* m away: set it to at most 0.39"),
        (
            {"dem_m": 1e-5, "tile_m": None},
            r"terrain cells of 1e-05 m needs about .* GB of memory.*larger mapping.voxel_m and "
            r"mapping.dem_m",
        ),
        (
            {"mosaic_m": 1e-5},
            r"mosaic_m=1e-05: the map would have .* cells, at most 4e\+09 are made: set it to at "
            r"least",
        ),
        (
            {"metrics_m": 1e9},
            r"metrics_m=1e\+09: a square .* needs about .* GB of memory.*: set it to at most",
        ),
        (
            {"metrics_m": 0.001},
            r"metrics_m=0.001: a square holds 3 terrain cells of .* m .*: set it to at least 0\.",
        ),
        ({"dem_m": 10.0}, r"dem_m=10: cells of so many meters are too large for this map: set it"),
        ({"mosaic_m": 5.0}, r"mosaic_m=5: cells of so many meters are too large .* at most 0\."),
    ],
)
def test_absurd_sizes_are_refused_with_what_to_set(
    tmp_path: Path, settings: dict[str, float], message: str
) -> None:
    with pytest.raises(MappingError, match=message):
        build(tmp_path, **settings)


def test_a_tile_too_large_for_the_memory_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(limits, "memory_bytes", lambda: 2e6)
    with pytest.raises(
        MappingError,
        match=r"a tile of 0.96 m .* GB of memory, a map may take 0.001: set mapping.tile_m to 0\.",
    ):
        build(tmp_path)


@pytest.mark.slow
def test_a_huge_tile_is_one_tile(tmp_path: Path) -> None:
    assert build(tmp_path, tile_m=1e9).points == build(tmp_path / "again").points


@pytest.mark.parametrize("value", [".inf", ".nan", "0", "-1"])
@pytest.mark.parametrize("key", ["voxel_m", "tile_m", "dem_m", "mosaic_m", "metrics_m"])
def test_sizes_are_positive_and_finite(key: str, value: str) -> None:
    with pytest.raises(ConfigError, match=f"mapping.{key}"):
        load_config(None, [f"mapping.{key}={value}"])


def test_a_tile_of_less_than_two_blocks_is_refused_before_anything_runs() -> None:
    with pytest.raises(
        ConfigError, match=r"tile_m=1e-06 is less than 16 voxels: set it to at least 0.16"
    ):
        load_config(None, ["mapping.tile_m=1e-6"])


def test_cells_and_tiles_follow_the_voxels() -> None:
    plain, coarse = MappingConfig(), MappingConfig(voxel_m=0.1)
    assert (plain.tile_edge_m, plain.terrain_cell_m, plain.mosaic_cell_m, plain.square_m) == (
        6.0,
        0.01,
        0.005,
        1.0,
    )
    assert (coarse.tile_edge_m, coarse.terrain_cell_m, coarse.mosaic_cell_m, coarse.square_m) == (
        60.0,
        0.1,
        0.05,
        10.0,
    )


def test_a_survey_too_long_for_its_voxels_is_refused(tmp_path: Path) -> None:
    trajectory = track(4, step_m=20_000.0)
    with pytest.raises(
        MappingError,
        match=r"reaches 30 km from its center.*: set mapping.voxel_m to at least 0.029",
    ):
        build(tmp_path, trajectory)


@pytest.mark.slow
def test_a_tile_without_a_surface_is_empty(tmp_path: Path) -> None:
    frames = [flat_frame(i) for i in range(3)]
    # ranges of one pixel in eight: no voxel has eight neighbors that are known
    for frame in frames[1:]:
        hidden = np.ones(frame.range_m.shape, np.bool_)
        hidden[::16, ::16] = False
        frame.range_m[hidden] = np.nan
    trajectory = track(3, step_m=3.0)
    summary = build_map(frames, PAIR, tmp_path, CONFIG, trajectory)
    assert summary.placed == 3
    assert read_cloud(tmp_path / "cloud.ply")["position"][:, 0].max() < 1


def test_a_map_without_any_surface_is_empty(tmp_path: Path) -> None:
    frame = flat_frame(0)
    frame.range_m[np.arange(128) % 9 != 4] = np.nan
    frame.range_m[:, np.arange(160) % 9 != 4] = np.nan
    assert build_map([frame], PAIR, tmp_path, CONFIG, track(1)).points == 0
    assert (tmp_path / "preview.png").exists()
    assert Surface.empty().parts.size == 0


def test_candidates_between_components_need_no_table_of_all_pairs() -> None:
    assert loops.between_components(np.zeros(200_000, np.int64)) == []
    components = np.repeat([0, 1, -1, 0], [3, 2, 4, 1])
    every = [
        (i, j)
        for i in range(10)
        for j in range(i + 1, 10)
        if -1 not in (a := components[[i, j]]) and a[0] != a[1]
    ]
    assert loops.between_components(components) == every
    many = loops.between_components(np.repeat([0, 1], 20_000))
    assert 1400 < len(many) <= 1500
    assert all(i < 20_000 <= j for i, j in many)


@pytest.mark.slow
def test_each_pass_of_a_map_in_components_has_its_own_progress(tmp_path: Path) -> None:
    trajectory = track(6)
    trajectory.T_world_camera[3:, 1, 3] += 50
    told: list[tuple[str, int, int]] = []
    progress = Workspace(progress=lambda what, done, total: told.append((what, done, total)))
    build_map([flat_frame(i) for i in range(6)], PAIR, tmp_path, CONFIG, trajectory, progress)
    for what in dict.fromkeys(what for what, _, _ in told):
        steps = [(done, total) for name, done, total in told if name == what]
        assert steps == [(i + 1, len(steps)) for i in range(len(steps))], what
    assert "fusing tiles, component 2 of 2" in {what for what, _, _ in told}


@pytest.mark.slow
def test_ranges_too_uncertain_for_the_voxels_take_no_memory(tmp_path: Path) -> None:
    """An oblique view: the bottom near, and far away a wall whose ranges are off by meters."""
    near = flat_frame(0)
    far_m = 20 * PAIR.ray_length
    rows = np.arange(128)[:, None] < 50
    range_m = np.where(rows, far_m, near.range_m).astype(np.float32)
    oblique = replace(near, range_m=range_m, range_std_m=(0.004 * range_m**2).astype(np.float32))
    certain = replace(oblique, range_std_m=near.range_std_m)
    reach_m = []
    for frame in (oblique, certain):
        index = FrameIndex.build([frame], PAIR, PointSampling(0.08, max_std_m=0.09))
        reach_m.append(float(index.points_m[0][index.certain[0], 2].max()))
    assert reach_m == pytest.approx([1.5, 20.0], rel=1e-3)
    noisy = replace(near, range_std_m=np.full_like(near.range_std_m, 5.0))
    # all alike: none is left out
    assert FrameIndex.build([noisy], PAIR, PointSampling(0.08, max_std_m=0.09)).certain[0].all()
    build_map([oblique], PAIR, tmp_path, CONFIG, track(1))
    assert read_cloud(tmp_path / "cloud.ply")["position"][:, 2].min() > -0.1


def test_auto_is_not_set() -> None:
    sizes = ["tile_m", "mosaic_m", "dem_m", "metrics_m"]
    assert load_config(None, [f"mapping.{key}=auto" for key in sizes]).mapping == MappingConfig()


@pytest.mark.parametrize(("altitude_m", "voxel_m"), [(0.4, 0.01), (1.0, 0.02), (4.0, 0.1)])
def test_voxels_follow_from_what_the_images_resolve_at_their_range(
    altitude_m: float, voxel_m: float
) -> None:
    """Five pixels of 5 mm at a meter, to a round number; the same for a frame more or less, or one
    that is lost.
    """
    auto = load_config(None, ["mapping.voxel_m=auto"]).mapping
    frames = [flat_frame(i, altitude_m=altitude_m) for i in range(3)]
    assert with_voxel(auto, frames, PAIR).voxel_m == voxel_m
    assert with_voxel(auto, [Unplaced("gone", "lost"), *frames], PAIR).voxel_m == voxel_m
    assert with_voxel(auto, [], PAIR).voxel_edge_m == MappingConfig().voxel_m
    assert with_voxel(MappingConfig(voxel_m=0.03), frames, PAIR).voxel_m == 0.03


@pytest.mark.slow
def test_the_map_says_which_voxels_it_chose(tmp_path: Path) -> None:
    config = CONFIG.model_copy(update={"voxel_m": None, "tile_m": None})
    build_map([flat_frame(0)], PAIR, tmp_path, config, track(1))
    assert json.loads((tmp_path / "map.json").read_text())["voxel_m"] == 0.05


@pytest.mark.parametrize(("voxel_m", "cell_m"), [(0.02, 0.01), (0.1, 0.01), (0.002, 0.01)])
def test_the_mosaic_of_a_small_area_is_as_fine_as_its_images(voxel_m: float, cell_m: float) -> None:
    """A pixel covers 7.5 mm here: neither coarser for coarse voxels, nor finer for fine ones."""
    config = MappingConfig(voxel_m=voxel_m)
    survey = Survey([flat_frame(0)], PAIR, FrameIndex.build([flat_frame(0)], PAIR))
    component = Component.of(survey, Placement(track(1).T_world_camera, np.zeros(1, np.int64)), 0)
    sized = with_mosaic_cell(config, component, cut(component, voxel_m, config.tile_edge_m))
    assert sized.mosaic_m == cell_m
    assert (
        with_mosaic_cell(
            config.model_copy(update={"mosaic_m": 0.3}), component, Tiling((), voxel_m, 1, 1)
        ).mosaic_m
        == 0.3
    )


def test_the_mosaic_of_a_large_area_has_half_a_voxel() -> None:
    survey = Survey([flat_frame(0)], PAIR, FrameIndex.build([flat_frame(0)], PAIR))
    component = Component.of(survey, Placement(track(1).T_world_camera, np.zeros(1, np.int64)), 0)
    square_km = Tiling((), 0.1, 1, int(1e6 / 0.8**2))
    assert with_mosaic_cell(MappingConfig(voxel_m=0.1), component, square_km).mosaic_m == 0.05


@pytest.mark.slow
def test_voxels_follow_the_surface_seen_not_the_air_in_front_of_it() -> None:
    """Looking forward over a floor, from 2 to 20 m, ranges noisy, against looking down: blocks over
    each of the ground's.
    """
    blocks = []
    for tilt_deg in (5.0, 72.0):
        spec = SurveySpec(
            pairs=2,
            lines=1,
            image_size=(256, 208),
            seed=3,
            tilt_deg=tilt_deg,
            altitude_m=(1.8, 1.8),
        )
        reef = ReefFrames(spec, noise_px=0.0)
        with np.errstate(invalid="ignore"):
            frames = [
                with_noisy_disparities(frame, reef.pair, 0.2, seed)
                for seed, frame in enumerate(reef)
            ]  # type: ignore[arg-type]
        for frame in frames:
            frame.range_m[~(frame.range_m < 20)] = np.nan
        sampling = PointSampling(spacing_m=0.2, max_std_m=0.05 / np.sqrt(MIN_WEIGHT))
        survey = Survey(frames, reef.pair, FrameIndex.build(frames, reef.pair, sampling))
        component = Component.of(
            survey, Placement(reef.trajectory.T_world_camera, np.zeros(2, np.int64)), 0
        )
        tiling = cut(component, 0.05, 30.0)
        blocks.append(sum(len(tile.blocks) for tile in tiling.tiles) / tiling.columns)
    assert blocks[1] < 2 * blocks[0]


def test_what_is_near_has_no_more_points_for_what_is_far_beyond_it() -> None:
    """Views that look ahead: their last tenth is eight times as far, and needs every pixel."""
    near = flat_frame(0)
    range_m = near.range_m.copy()
    range_m[:13] *= 8
    ahead = replace(near, range_m=range_m, range_std_m=(0.004 * range_m**2).astype(np.float32))
    down, oblique = FrameIndex.build([near, ahead], PAIR).points_m
    assert (oblique[:, 2] > 3).sum() == 13 * 160
    closest = oblique[oblique[:, 2] < 3]
    assert 0.8 * len(down) < len(closest) < 2 * len(down)
    between_m = np.diff(np.unique(closest[:, 0]))
    assert between_m[between_m > 1e-4].max() <= SAMPLING.spacing_m + 1e-3
