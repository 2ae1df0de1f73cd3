"""Frames with known poses become the true surface, whatever is cut, stopped, missing or in the
way.
"""

import dataclasses
import errno
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pytest
from mapping_scene import CONFIG, PAIR, ReefFrames, flat_frame, height_at, read_cloud, track
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from benchmarks.map_errors import nearest_distance_m
from stereo_seecolor.compute.threads import limit_cores
from stereo_seecolor.config import MappingConfig
from stereo_seecolor.errors import OutputError
from stereo_seecolor.extras.synthetic.survey import SurveySpec
from stereo_seecolor.files import raw_arrays
from stereo_seecolor.files.ply import VERTEX
from stereo_seecolor.mapping import kept_frames
from stereo_seecolor.mapping.surface import extraction
from stereo_seecolor.mapping.surface.extraction import Volume, extract
from stereo_seecolor.mapping.surface.surface import Surface
from stereo_seecolor.mapping.survey_map import Workspace, build_map
from stereo_seecolor.records import SurveyFrame


def read_triangles(path: Path) -> NDArray[np.int32]:
    content = path.read_bytes()
    header, body = content.split(b"end_header\n", 1)
    vertices, faces = (
        int(header.split(b"element %s " % what)[1].split()[0]) for what in (b"vertex", b"face")
    )
    face = np.dtype([("count", "u1"), ("indices", "<i4", 3)])
    return np.frombuffer(body, face, faces, offset=vertices * VERTEX.itemsize)["indices"]


@pytest.mark.slow
def test_a_flat_bottom_comes_out_flat_and_in_its_color(tmp_path: Path) -> None:
    summary = build_map([flat_frame(i) for i in range(4)], PAIR, tmp_path, CONFIG, track(4))
    cloud = read_cloud(tmp_path / "cloud.ply")
    assert summary.points == len(cloud) > 1000
    np.testing.assert_allclose(cloud["position"][:, 2], 0, atol=1e-4)
    np.testing.assert_allclose(
        cloud["normal"], np.broadcast_to([0, 0, 1], cloud["normal"].shape), atol=1e-2
    )
    np.testing.assert_array_equal(np.unique(cloud["color"], axis=0), [[200, 120, 40]])
    x = cloud["position"][:, 0]
    assert x.min() == pytest.approx(-0.6, abs=0.03)
    assert x.max() == pytest.approx(0.9 + 0.6, abs=0.03)


@pytest.mark.slow
def test_fine_voxels_leave_no_holes_in_what_was_seen(tmp_path: Path) -> None:
    # pixels of 7.5 mm: every 16th would miss blocks of 32 mm
    config = CONFIG.model_copy(update={"voxel_m": 0.004})
    build_map([flat_frame(i) for i in range(2)], PAIR, tmp_path, config, track(2))
    position = read_cloud(tmp_path / "cloud.ply")["position"]
    x, y = np.floor(position[:, :2].T / 0.02).astype(int)
    filled = np.zeros((60, 60), np.bool_)
    inside = (x >= -25) & (x < 35) & (y >= -20) & (y < 20)
    filled[y[inside] + 20, x[inside] + 25] = True
    assert filled[:40].all()


@pytest.mark.slow
def test_ground_seen_at_a_grazing_angle_has_no_stripes(tmp_path: Path) -> None:
    """A road before a camera that looks ahead, 1.65 m above it: rays at 9 to 18 degrees, voxels of
    10 cm.
    """
    rows = np.arange(128) - PAIR.cy_px
    depth_m = np.where(rows > 10, PAIR.focal_px * 1.65 / np.maximum(rows, 1), np.nan)[:, None]
    range_m = (depth_m * PAIR.ray_length).astype(np.float32)
    frames = [
        dataclasses.replace(flat_frame(i), range_m=range_m, range_std_m=np.full_like(range_m, 0.02))
        for i in range(4)
    ]
    poses = track(4, altitude_m=1.65, step_m=0.7)
    poses.T_world_camera[:, :3, :3] = [[0, 0, 1], [-1, 0, 0], [0, -1, 0]]
    large = {"voxel_m": 0.1, "tile_m": 100.0, "dem_m": 0.1, "mosaic_m": 0.1, "metrics_m": 1.0}
    build_map(frames, PAIR, tmp_path, CONFIG.model_copy(update=large), poses)
    position = read_cloud(tmp_path / "cloud.ply")["position"]
    x, y, z = position.T
    seen = (x > 6) & (x < 10) & (abs(y) < 1)
    assert np.abs(z[seen]).max() < 0.02
    filled = np.zeros((20, 10), np.bool_)
    filled[((x[seen] - 6) / 0.2).astype(int), ((y[seen] + 1) / 0.2).astype(int)] = True
    assert filled.all()


@pytest.mark.slow
def test_tiles_join_without_seams(tmp_path: Path) -> None:
    frames = [flat_frame(i, altitude_m=1.5) for i in range(4)]
    waves = [
        dataclasses.replace(
            f, range_m=f.range_m + 0.05 * np.sin(np.arange(160) / 9).astype(np.float32)
        )
        for f in frames
    ]
    one, many = tmp_path / "one", tmp_path / "many"
    build_map(waves, PAIR, one, CONFIG.model_copy(update={"tile_m": 100.0}), track(4))
    build_map(waves, PAIR, many, CONFIG.model_copy(update={"tile_m": 0.5}), track(4))
    whole, tiled = (read_cloud(folder / "cloud.ply") for folder in (one, many))
    assert len(whole) == len(tiled)
    np.testing.assert_array_equal(
        np.unique(whole["position"], axis=0), np.unique(tiled["position"], axis=0)
    )
    assert len(read_triangles(one / "mesh.ply")) == len(read_triangles(many / "mesh.ply"))
    edges = np.sort(read_triangles(many / "mesh.ply")[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    counts = np.unique(np.unique(edges, axis=0, return_counts=True)[1], return_counts=True)[1]
    whole_edges = np.sort(
        read_triangles(one / "mesh.ply")[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1
    )
    np.testing.assert_array_equal(
        counts,
        np.unique(np.unique(whole_edges, axis=0, return_counts=True)[1], return_counts=True)[1],
    )


@pytest.mark.slow
def test_a_fish_that_others_see_through_is_carved_away(tmp_path: Path) -> None:
    frames = [flat_frame(i, fish=i == 2) for i in range(5)]
    build_map(frames, PAIR, tmp_path, CONFIG, track(5, step_m=0.15))
    cloud = read_cloud(tmp_path / "cloud.ply")
    assert np.abs(cloud["position"][:, 2]).max() < 0.03
    assert not (cloud["color"] == [255, 0, 255]).all(axis=1).any()


@pytest.mark.slow
def test_sure_measurements_outweigh_unsure_ones(tmp_path: Path) -> None:
    sure, unsure = flat_frame(0), flat_frame(1)
    unsure = dataclasses.replace(
        unsure, range_m=unsure.range_m - 0.03 * PAIR.ray_length, range_std_m=3 * unsure.range_std_m
    )
    build_map([sure, unsure], PAIR, tmp_path, CONFIG, track(2, step_m=0.0))
    assert np.median(read_cloud(tmp_path / "cloud.ply")["position"][:, 2]) == pytest.approx(
        0.03 / 10, abs=1e-3
    )


@pytest.mark.slow
def test_a_view_counts_by_how_fine_its_pixels_are(tmp_path: Path) -> None:
    # pixels of 5 and 20 mm, voxels of 20
    near, far = (flat_frame(0, 1.0, (100, 100, 100)), flat_frame(1, 4.0, (200, 200, 200)))
    trajectory = track(2, step_m=0.0)
    trajectory.T_world_camera[:, 2, 3] = [1.0, 4.0]
    build_map([near, far], PAIR, tmp_path, CONFIG, trajectory)
    cloud = read_cloud(tmp_path / "cloud.ply")
    below = np.hypot(cloud["position"][:, 0], cloud["position"][:, 1]) < 0.1
    assert cloud["color"][below].mean() == pytest.approx(
        (100 / (1 + 1 / 16) + 200 / 2) / (1 / (1 + 1 / 16) + 1 / 2), abs=2
    )


@pytest.mark.slow
@pytest.mark.parametrize("why", ["clipped", "unrecoverable"])
def test_a_doubtful_color_hardly_counts(tmp_path: Path, why: str) -> None:
    good, bad = (
        flat_frame(0, color=(100, 100, 100)),
        flat_frame(1, color=(255 if why == "clipped" else 200,) * 3),
    )
    if why == "unrecoverable":
        bad = dataclasses.replace(bad, unrecoverable=np.ones(bad.range_m.shape, np.bool_))
    build_map([good, bad], PAIR, tmp_path, CONFIG, track(2, step_m=0.0))
    assert read_cloud(tmp_path / "cloud.ply")["color"].mean() == pytest.approx(100, abs=4)


@pytest.mark.slow
def test_edges_are_not_darkened_by_voxels_without_a_color(tmp_path: Path) -> None:
    frames = [flat_frame(i, altitude_m=2.0) for i in range(5)]
    # a box half a meter high, 0.6 m wide, seen from all sides: its rim hides what is below
    for i, frame in enumerate(frames):
        left = round(80 + 200 * (-0.3 - 0.3 * (i - 2)) / 1.5)
        frame.range_m[44:84, max(left, 0) : max(left + 80, 0)] *= np.float32(0.75)
    build_map(frames, PAIR, tmp_path, CONFIG, track(5, altitude_m=2.0))
    cloud = read_cloud(tmp_path / "cloud.ply")
    assert cloud["position"][:, 2].max() > 0.4
    np.testing.assert_array_equal(np.unique(cloud["color"], axis=0), [[200, 120, 40]])


@pytest.mark.slow
def test_a_reef_comes_out_true(tmp_path: Path) -> None:
    frames = ReefFrames(SurveySpec(pairs=6, lines=2, image_size=(240, 192)), noise_px=0.05)
    build_map(
        frames,
        frames.pair,
        tmp_path,
        MappingConfig(voxel_m=0.02, mosaic_m=0.02, dem_m=0.02),
        frames.trajectory,
    )
    position = read_cloud(tmp_path / "cloud.ply")["position"]
    error_m = np.abs(position[:, 2] - height_at(frames.reef, position))
    assert np.median(error_m) < 0.01


class Counting(Sequence[SurveyFrame]):
    """Frames that count how often they are read."""

    def __init__(self, frames: list[SurveyFrame]) -> None:
        self.frames, self.reads = frames, 0

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, i: int) -> SurveyFrame:  # type: ignore[override]
        self.reads += 1
        return self.frames[i]


def stopped_at_tile(
    number: int, frames: list[SurveyFrame], folder: Path, config: MappingConfig = CONFIG
) -> None:
    """Make a map until so many tiles are fused."""

    def stop(what: str, done: int, total: int) -> None:
        if what == "fusing tiles" and done == number:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        build_map(frames, PAIR, folder, config, track(6), Workspace(progress=stop))


@pytest.mark.slow
def test_a_stopped_run_goes_on_where_it_was(tmp_path: Path) -> None:
    frames = [flat_frame(i) for i in range(6)]
    straight, resumed = tmp_path / "straight", tmp_path / "resumed"
    build_map(frames, PAIR, straight, CONFIG, track(6))
    stopped_at_tile(2, frames, resumed)
    assert not (resumed / "cloud.ply").exists()
    fused: list[int] = []

    def progress(what: str, done: int, total: int) -> None:
        fused.extend([done] if what == "fusing tiles" else [])

    build_map(frames, PAIR, resumed, CONFIG, track(6), Workspace(progress=progress))
    assert fused[0] == 3
    assert (resumed / "mesh.ply").read_bytes() == (straight / "mesh.ply").read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize("disk", ["large", "small", "full"])
def test_each_frame_is_decoded_once_where_the_disk_has_room(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, disk: str
) -> None:
    frames = Counting([flat_frame(i, color=(10, 20, 30 + 40 * i)) for i in range(6)])
    build_map(frames.frames, PAIR, tmp_path / "plain", CONFIG, track(6))
    if disk == "full":
        monkeypatch.setattr(
            raw_arrays, "temporary_path", lambda path: path.parent / "missing" / path.name
        )
    if disk == "small":
        monkeypatch.setattr(kept_frames, "SETTINGS", kept_frames.KeepingSettings(most_bytes=0))
    build_map(frames, PAIR, tmp_path / "kept", CONFIG, track(6))
    first_look = 1  # whether the voxels suit the scene
    assert (
        frames.reads == len(frames) + first_look
        if disk == "large"
        else frames.reads > 2 * len(frames)
    )
    for name in ("cloud.ply", "mesh.ply", "orthomosaic.tif", "dem.tif"):
        assert (tmp_path / "kept" / name).read_bytes() == (tmp_path / "plain" / name).read_bytes()
    assert not list(tmp_path.rglob("*.raw"))


@pytest.mark.slow
def test_tiles_of_frames_that_were_made_anew_are_not_kept(tmp_path: Path) -> None:
    stopped_at_tile(2, [flat_frame(i) for i in range(6)], tmp_path)
    assert list((tmp_path / ".scratch" / "tiles").rglob("*.npz"))
    build_map(
        [flat_frame(i, color=(10, 20, 230)) for i in range(6)], PAIR, tmp_path, CONFIG, track(6)
    )
    np.testing.assert_array_equal(
        np.unique(read_cloud(tmp_path / "cloud.ply")["color"], axis=0), [[10, 20, 230]]
    )


@pytest.mark.slow
def test_a_full_disk_is_named_and_what_is_done_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    saved = []
    real = np.savez

    def full_at_third_tile(file: BinaryIO, **content: object) -> None:
        saved.extend([file] if "tiles" in Path(file.name).parts else [])
        if len(saved) == 3:
            raise OSError(errno.ENOSPC, "No space left on device")
        real(file, **content)

    monkeypatch.setattr(np, "savez", full_at_third_tile)
    with pytest.raises(OutputError, match="No space left on device: free disk space and run again"):
        build_map([flat_frame(i) for i in range(6)], PAIR, tmp_path, CONFIG, track(6))
    assert len(list((tmp_path / ".scratch/tiles").rglob("*.npz"))) == 2
    assert not list(tmp_path.rglob(".writing-*"))


@pytest.mark.slow
def test_a_disk_too_small_for_the_mosaic_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(np, "save", full)
    with pytest.raises(OutputError, match=r"terrain.*cannot be written: No space left"):
        build_map([flat_frame(i) for i in range(3)], PAIR, tmp_path, CONFIG, track(3))
    assert (tmp_path / "mesh.ply").exists()


@pytest.mark.slow
def test_a_jump_makes_two_maps(tmp_path: Path) -> None:
    trajectory = track(7)
    trajectory.T_world_camera[4:, 1, 3] += 50
    summary = build_map([flat_frame(i) for i in range(7)], PAIR, tmp_path, CONFIG, trajectory)
    assert summary.components == (4, 3)
    assert "jump 50.0 m between f3 and f4" in summary.warnings[0]
    assert read_cloud(tmp_path / "cloud.ply")["position"][:, 1].max() < 1
    assert read_cloud(tmp_path / "piece_1" / "cloud.ply")["position"][:, 1].min() > 49


@pytest.mark.slow
def test_a_frame_without_ranges_does_no_harm(tmp_path: Path) -> None:
    frames = [flat_frame(i) for i in range(3)]
    frames[1] = dataclasses.replace(frames[1], range_m=np.full_like(frames[1].range_m, np.nan))
    assert build_map(frames, PAIR, tmp_path, CONFIG, track(3)).placed == 3


def volume_of(
    distance_m: Callable[[NDArray, NDArray, NDArray], NDArray], seed: int, unknown: float = 0.02
) -> Volume:
    """All blocks of a cube from -3 to 2 blocks, some voxels unknown."""
    voxel_m = 0.02
    blocks = (
        np.stack(np.meshgrid(*[np.arange(-3, 3)] * 3, indexing="ij"), axis=-1)
        .reshape(-1, 3)
        .astype(np.int32)
    )
    volume = Volume.empty(blocks, voxel_m)
    k, j, i = np.indices((8, 8, 8))
    x, y, z = (
        (blocks[:, axis, None, None, None] * 8 + index) * voxel_m
        for axis, index in enumerate((i, j, k))
    )
    volume.tsdf[:] = np.clip(distance_m(x, y, z) / (4 * voxel_m), -1, 1)
    volume.weight[:] = np.random.default_rng(seed).random(volume.weight.shape) >= unknown
    return volume


def extracted(volume: Volume) -> Surface:
    return extract(volume, np.arange(len(volume.blocks)))


def test_a_ball_is_closed_and_of_its_size() -> None:
    volume = volume_of(lambda x, y, z: np.sqrt(x * x + y * y + z * z) - 0.3, 0, unknown=0)
    surface = extracted(volume)
    radius = np.linalg.norm(surface.points_m, axis=1)
    np.testing.assert_allclose(radius, 0.3, atol=0.05 * volume.voxel_m)
    np.testing.assert_allclose(surface.normals, surface.points_m / radius[:, None], atol=0.05)
    assert surface.areas_m2.sum() == pytest.approx(4 * np.pi * 0.3**2, rel=0.01)
    a, b, c = np.moveaxis(surface.points_m[surface.triangles].astype(float), 1, 0)
    # positive: outside is outside
    assert (np.cross(a, b) * c).sum() / 6 == pytest.approx(4 / 3 * np.pi * 0.3**3, rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_the_points_lie_where_the_distance_along_an_edge_is_zero(seed: int) -> None:
    rough = np.random.default_rng(seed).normal(0, 0.01, (216, 8, 8, 8))
    volume = volume_of(lambda x, y, z: np.sqrt(x * x + y * y + z * z) - 0.3 + rough, seed)
    surface = extracted(volume)
    wanted = zero_crossings(volume)
    assert len(np.unique(surface.points_m, axis=0)) == len(surface.points_m) == len(wanted)
    assert nearest_distance_m(surface.points_m, wanted, 0.1).max() < 1e-4 * volume.voxel_m


@pytest.mark.slow
def test_a_rough_surface_has_no_holes_but_where_voxels_are_unknown() -> None:
    rough = np.random.default_rng(3).normal(0, 1, (216, 8, 8, 8))
    volume = volume_of(lambda x, y, z: rough, 0, unknown=0)  # every case of a cube
    triangles = extracted(volume).triangles.astype(np.int64)
    sides = np.concatenate([triangles[:, [k, (k + 1) % 3]] for k in range(3)])
    forth, times = np.unique(sides[:, 0] << 32 | sides[:, 1], return_counts=True)
    assert (times == 1).all()  # a side lies between two triangles that face the same way
    alone = ~np.isin(sides[:, 1] << 32 | sides[:, 0], forth)
    # the cube's faces are voxels -24 and 15
    ends = np.abs(extracted(volume).points_m[sides[alone]] / volume.voxel_m + 4.5)
    assert (ends.max(axis=2) > 19.5 - 1e-3).all()


@pytest.mark.parametrize("first", [0, 100])
def test_cores_change_nothing_in_what_is_extracted(
    first: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    volume = volume_of(lambda x, y, z: z + 0.1 * np.sin(20 * x), 5)
    own = np.arange(first, len(volume.blocks))
    one = extract(volume, own)
    monkeypatch.setattr(extraction, "PART_BLOCKS", 1)
    limit_cores(5)
    try:
        five = extract(volume, own)
    finally:
        limit_cores(os.cpu_count() or 1)
    for name in ("points_m", "normals", "colors", "triangles"):
        np.testing.assert_array_equal(getattr(one, name), getattr(five, name))


@pytest.mark.parametrize("seed", [0, 1])
def test_parts_and_areas_are_those_of_scipy_and_numpy(seed: int) -> None:
    generator = np.random.default_rng(seed)
    points, triangles = (
        generator.normal(0, 1, (200, 3)).astype(np.float32),
        generator.integers(0, 200, (60, 3)).astype(np.int32),
    )
    surface = Surface(points, points, np.zeros((200, 3), np.uint8), triangles)
    ends = triangles[:, [0, 1]].ravel(), triangles[:, [1, 2]].ravel()
    graph = coo_array((np.ones(len(ends[0])), ends), (200, 200))
    np.testing.assert_array_equal(surface.parts, connected_components(graph, directed=False)[1])
    a, b, c = np.moveaxis(points[triangles].astype(float), 1, 0)
    np.testing.assert_allclose(
        surface.areas_m2, np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2, rtol=1e-12
    )


def zero_crossings(volume: Volume) -> NDArray[np.float64]:
    """On every edge of a cube whose corners are all known."""
    size = 48
    tsdf, known = np.ones((size,) * 3), np.zeros((size,) * 3, np.bool_)
    for block, distance, weight in zip(volume.blocks, volume.tsdf, volume.weight, strict=True):
        x, y, z = (slice(8 * (n + 3), 8 * (n + 4)) for n in block)
        tsdf[x, y, z], known[x, y, z] = distance.transpose(2, 1, 0), weight.transpose(2, 1, 0) > 0
    cubes = np.ones((size - 1,) * 3, np.bool_)
    for x, y, z in np.ndindex(2, 2, 2):
        cubes &= known[x : size - 1 + x, y : size - 1 + y, z : size - 1 + z]
    inside = np.zeros((size,) * 3, np.bool_)
    for x, y, z in np.ndindex(2, 2, 2):
        inside[x : size - 1 + x, y : size - 1 + y, z : size - 1 + z] |= cubes
    points = []
    for axis in range(3):
        one = np.eye(3, dtype=int)[axis]
        for at in np.argwhere(inside):
            other = at + one
            if (
                other[axis] >= size
                or (tsdf[tuple(at)] < 0) == (tsdf[tuple(other)] < 0)
                or not has_cube(cubes, at, axis)
            ):
                continue
            t = tsdf[tuple(at)] / (tsdf[tuple(at)] - tsdf[tuple(other)])
            points.append((at - 24 + t * one) * volume.voxel_m)
    return np.array(points)


def has_cube(cubes: NDArray[np.bool_], at: NDArray[np.int64], axis: int) -> bool:
    """Whether one of the four cubes around an edge is known."""
    low = np.maximum(at - (np.arange(3) != axis), 0)
    return bool(cubes[tuple(slice(a, b + 1) for a, b in zip(low, at, strict=True))].any())
