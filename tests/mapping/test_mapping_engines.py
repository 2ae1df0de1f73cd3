"""Open3D in place of our own voxels (mapping.engine: open3d): the same map within millimeters, tile
by tile, to the byte again.
"""

import json
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import rasterio
from conftest import Cli
from mapping_scene import (
    CONFIG,
    PAIR,
    ReefFrames,
    flat_frame,
    flat_frames,
    height_at,
    read_cloud,
    track,
)
from test_mapping_fusion import read_triangles, stopped_at_tile

from stereo_seecolor.config import MappingConfig
from stereo_seecolor.errors import DeviceError
from stereo_seecolor.extras.synthetic.survey import SurveySpec
from stereo_seecolor.mapping.surface.engines import engine
from stereo_seecolor.mapping.surface.own_engine import fuse_tile
from stereo_seecolor.mapping.surface.tiles import Tile, Tiling
from stereo_seecolor.mapping.survey_map import Workspace, build_map

TILES = CONFIG.model_copy(update={"poses": "given"})
OPEN3D = TILES.model_copy(update={"engine": "open3d"})
LINE = "pip install 'stereo-seecolor[open3d]'"


@pytest.fixture
def without_open3d(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "open3d", None)
    monkeypatch.delitem(sys.modules, "stereo_seecolor.mapping.surface.open3d_engine", raising=False)


@pytest.fixture(scope="module")
def reef() -> ReefFrames:
    return ReefFrames(
        SurveySpec(image_size=(240, 200), pairs=9, lines=1, fish=0, seed=3), noise_px=0.05
    )


@pytest.fixture(scope="module")
def mapped(
    reef: ReefFrames, tmp_path_factory: pytest.TempPathFactory
) -> Callable[[MappingConfig], Path]:
    """The folder of the map of the reef with some settings, made once; to be read only."""
    return cache(lambda config: map_of(reef, tmp_path_factory.mktemp("map"), config))


def map_of(reef: ReefFrames, folder: Path, config: MappingConfig) -> Path:
    build_map(reef, reef.pair, folder, config, reef.trajectory)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("config", [TILES, OPEN3D], ids=["tiles", "open3d"])
def test_a_flat_bottom_comes_out_flat_and_in_its_color(
    tmp_path: Path, config: MappingConfig
) -> None:
    build_map(flat_frames(4), PAIR, tmp_path, config, track(4))
    cloud = read_cloud(tmp_path / "cloud.ply")
    assert len(cloud) > 1000
    np.testing.assert_allclose(cloud["position"][:, 2], 0, atol=1e-4)
    np.testing.assert_allclose(
        cloud["normal"], np.broadcast_to([0, 0, 1], cloud["normal"].shape), atol=1e-2
    )
    np.testing.assert_array_equal(np.unique(cloud["color"], axis=0), [[200, 120, 40]])
    a, b, c = np.moveaxis(cloud["position"][read_triangles(tmp_path / "mesh.ply")], 1, 0)
    assert (np.cross(b - a, c - a)[:, 2] > 0).all()
    assert json.loads((tmp_path / "map.json").read_text())["engine"] == config.engine


@pytest.mark.slow
def test_tiles_of_open3d_join_without_seams(mapped: Callable[[MappingConfig], Path]) -> None:
    one, many = mapped(OPEN3D.model_copy(update={"tile_m": 100.0})), mapped(OPEN3D)
    whole, tiled = (read_cloud(folder / "cloud.ply")["position"] for folder in (one, many))
    np.testing.assert_array_equal(np.unique(whole, axis=0), np.unique(tiled, axis=0))
    assert len(read_triangles(one / "mesh.ply")) == len(read_triangles(many / "mesh.ply"))


@pytest.mark.slow
@pytest.mark.parametrize("config", [TILES, OPEN3D], ids=["tiles", "open3d"])
def test_both_engines_find_the_true_reef(
    mapped: Callable[[MappingConfig], Path], reef: ReefFrames, config: MappingConfig
) -> None:
    position = read_cloud(mapped(config) / "cloud.ply")["position"]
    # at voxels of 2 cm
    assert np.median(np.abs(position[:, 2] - height_at(reef.reef, position))) < 0.007


@pytest.mark.slow
def test_both_engines_agree_on_the_terrain(mapped: Callable[[MappingConfig], Path]) -> None:
    ours, theirs = terrain(mapped(TILES)), terrain(mapped(OPEN3D))
    both = ours.keys() & theirs.keys()
    # at voxels of 2 cm
    assert np.median([abs(ours[cell] - theirs[cell]) for cell in both]) < 0.006
    assert len(both) > 0.97 * max(len(ours), len(theirs))


def terrain(folder: Path) -> dict[tuple[int, int], float]:
    """The height of each cell, by its place in whole cells."""
    with rasterio.open(folder / "dem.tif") as dem:
        heights_m, (left, top) = (
            dem.read(1),
            (round(dem.transform.c / dem.transform.a), round(dem.transform.f / dem.transform.a)),
        )
    return {
        (left + x, top - y): heights_m[y, x]
        for y, x in np.argwhere(np.isfinite(heights_m)).tolist()
    }


@pytest.mark.slow
def test_a_fish_that_others_see_through_is_carved_away_by_open3d(tmp_path: Path) -> None:
    build_map(
        [flat_frame(i, fish=i == 2) for i in range(5)],
        PAIR,
        tmp_path,
        OPEN3D,
        track(5, step_m=0.15),
    )
    assert not (read_cloud(tmp_path / "cloud.ply")["color"] == [255, 0, 255]).all(axis=1).any()


@pytest.mark.slow
def test_a_tile_that_no_frame_reaches_is_empty() -> None:
    blocks = np.zeros((1, 3), np.int32)
    tiling = Tiling((), 0.02, 6, 1)
    nothing = flat_frame(0)
    nothing.range_m[:] = np.nan
    for frames in ([], [(nothing, track(1).T_world_camera[0])]):
        assert not len(engine("open3d")(Tile((0, 0), blocks, (0,)), tiling, frames, PAIR).points_m)


def test_open3d_is_not_imported_before_it_is_chosen(without_open3d: None) -> None:
    assert engine("tiles") is fuse_tile
    with pytest.raises(DeviceError, match="needs Open3D"):
        engine("open3d")


def test_a_missing_open3d_is_named_before_the_first_frame(
    without_open3d: None, cli: Cli, tmp_path: Path
) -> None:
    sides = ("--left", tmp_path, "--right", tmp_path, "--calib", tmp_path / "cam.yaml")
    code, _, said = cli(
        "run", *sides, "--out", tmp_path / "out", "--fuse", "--set", "mapping.engine=open3d"
    )
    assert code == 1
    assert said.startswith(
        "stereo-seecolor: mapping.engine: open3d needs Open3D, which is not installed"
    )
    assert said.rstrip().endswith(LINE) and said.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_tiles_of_one_engine_are_not_taken_for_those_of_another(tmp_path: Path) -> None:
    frames = flat_frames(6)
    build_map(frames, PAIR, tmp_path / "straight", OPEN3D, track(6))
    stopped_at_tile(2, frames, tmp_path / "stopped")
    build_map(frames, PAIR, tmp_path / "stopped", OPEN3D, track(6))
    for name in ("cloud.ply", "mesh.ply", "map.json"):
        assert (tmp_path / "stopped" / name).read_bytes() == (
            tmp_path / "straight" / name
        ).read_bytes()


@pytest.mark.slow
def test_a_map_by_open3d_that_was_stopped_goes_on_where_it_was(tmp_path: Path) -> None:
    frames, fused = flat_frames(6), []
    build_map(frames, PAIR, tmp_path / "straight", OPEN3D, track(6))
    stopped_at_tile(2, frames, tmp_path / "stopped", OPEN3D)
    workspace = Workspace(
        progress=lambda what, done, total: fused.append(done) if what == "fusing tiles" else None
    )
    build_map(frames, PAIR, tmp_path / "stopped", OPEN3D, track(6), workspace)
    assert fused[0] == 3
    for name in ("cloud.ply", "mesh.ply", "dem.tif", "orthomosaic.tif"):
        assert (tmp_path / "stopped" / name).read_bytes() == (
            tmp_path / "straight" / name
        ).read_bytes()
