"""Fusing a run's folder: whose poses they are, who else writes there, and what is damaged in it."""

import dataclasses
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import Dive
from mapping_scene import (
    CONFIG,
    PAIR,
    ReefFrames,
    flat_frame,
    height_at,
    read_cloud,
    track,
    write_run,
)
from numpy.typing import NDArray

from calibration import Camera, Rectification, StereoRig
from calibration.formats import write_rig
from calibration.geometry import DISPARITY_STD_PX
from calibration.port import FlatPort, FlatWindow
from calibration.rectification import rectified_points
from calibration.refraction import CameraInWater
from calibration.transforms import inverse, rotation_from_vector
from stereo_seecolor.checks.verdict import DiveVerdict
from stereo_seecolor.cli import main
from stereo_seecolor.cli.results import map_exit_code
from stereo_seecolor.commands import stereo_inputs
from stereo_seecolor.commands.fuse import fuse
from stereo_seecolor.commands.run import run
from stereo_seecolor.config import MappingConfig, RunConfig
from stereo_seecolor.errors import FrameError, InputError, MappingError, OutputError
from stereo_seecolor.extras.synthetic.survey import SurveySpec
from stereo_seecolor.files.decode import eight_bit
from stereo_seecolor.files.srgb import decode_srgb
from stereo_seecolor.files.tum import write_tum
from stereo_seecolor.inputs.trajectories.axes import R_ENU_NED
from stereo_seecolor.mapping import kept_frames, survey_map
from stereo_seecolor.mapping.frame_index import FrameIndex
from stereo_seecolor.mapping.survey import Survey
from stereo_seecolor.mapping.survey_frames import ReadableFrames
from stereo_seecolor.mapping.track import odometry
from stereo_seecolor.records import SurveyFrame
from stereo_seecolor.run_folder.lease import held

MAPPING = MappingConfig(voxel_m=0.02, mosaic_m=0.02, dem_m=0.02)


def toed_in_rig(port: FlatPort | None = None, size: tuple[int, int] = (640, 480)) -> StereoRig:
    """The left camera is turned by five degrees by rectification."""
    camera = Camera(
        np.array([[0.8 * size[0], 0, size[0] / 2], [0, 0.8 * size[0], size[1] / 2], [0, 0, 1]]),
        np.zeros(5),
        size,
    )
    T = np.eye(4)
    T[:3, :3] = rotation_from_vector(np.array([0.03, 0.17, -0.02]))
    T[:3, 3] = T[:3, :3] @ [-0.12, 0.004, 0.006]
    return StereoRig(camera, camera, T, "air" if port else "water", port=port)


def test_poses_of_the_raw_camera_put_things_where_the_rectified_image_shows_them() -> None:
    rig = toed_in_rig()
    T_world_raw = np.eye(4)
    T_world_raw[:3, :3], T_world_raw[:3, 3] = (
        rotation_from_vector(np.array([2.9, 0.3, -0.2])),
        [3, -2, 1],
    )
    points_raw = np.random.default_rng(0).uniform([-0.5, -0.4, 1.5], [0.5, 0.4, 2.5], (20, 3))
    points_world = points_raw @ T_world_raw[:3, :3].T + T_world_raw[:3, 3]
    shown, _ = rectified_points(
        rig,
        *[cv2.projectPoints(points_raw, np.zeros(3), np.zeros(3), rig.left.K, None)[0][:, 0]] * 2,
    )
    rectification = Rectification.from_rig(rig)
    T = inverse(T_world_raw @ inverse(rectification.T_rectified_left))
    projected = (points_world @ T[:3, :3].T + T[:3, 3]) @ rectification.pair.P_left.T
    np.testing.assert_allclose(projected[:, :2] / projected[:, 2:], shown, atol=1e-6)


@pytest.mark.slow
def test_behind_a_flat_port_the_rectified_cameras_center_moves_as_well() -> None:
    window = FlatWindow(0.05, 0.01, np.array([0.0, 0, 1]))
    rig = toed_in_rig(FlatPort(window, window, 2.0, 1.34))
    rectification = Rectification.from_rig(rig)
    left = CameraInWater(rig.left, window, rig.port)  # type: ignore[arg-type]
    points_raw = np.random.default_rng(0).uniform([-0.5, -0.4, 1.5], [0.5, 0.4, 2.5], (20, 3))
    shown, _ = rectified_points(rig, *[left.project_points(points_raw)] * 2)
    T = rectification.T_rectified_left
    projected = (points_raw @ T[:3, :3].T + T[:3, 3]) @ rectification.pair.P_left.T
    assert np.abs(T[:3, 3]).max() > 0.01
    np.testing.assert_allclose(projected[:, :2] / projected[:, 2:], shown, atol=0.5)


@pytest.mark.slow
def test_a_run_writes_down_how_rectification_turned_the_camera(
    make_dive: Callable[..., Dive], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # the images are another rig's, which a run would refuse
    monkeypatch.setattr(stereo_inputs, "check_rig", lambda *_: DiveVerdict())
    dive = make_dive(1)
    rig = toed_in_rig(size=(176, 128))
    write_rig(rig, dive.root / "toed.yaml")
    run(dive.root / "L", dive.root / "R", dive.root / "toed.yaml", tmp_path / "out")
    content = json.loads((tmp_path / "out" / "run.json").read_text())
    np.testing.assert_allclose(
        content["T_rectified_left"], Rectification.from_rig(rig).T_rectified_left, atol=1e-9
    )
    assert np.abs(np.subtract(content["T_rectified_left"], np.eye(4))).max() > 0.05


def acfr_text(names: tuple[str, ...], T_world_raw: NDArray[np.float64]) -> str:
    """Poses in east-north-up as ACFR writes them: north-east-down, Euler angles in radians."""
    rows = ["% STEREO_POSE_FILE VERSION 2", "-23.5", "152.0"]
    for i, (name, T) in enumerate(zip(names, T_world_raw, strict=True)):
        R, (north, east, down) = R_ENU_NED.T @ T[:3, :3], R_ENU_NED.T @ T[:3, 3]
        angles = np.arctan2(R[2, 1], R[2, 2]), -np.arcsin(R[2, 0]), np.arctan2(R[1, 0], R[0, 0])
        numbers = [i, i, -23.5, 152.0, north, east, down, *angles]
        rows.append(" ".join(f"{n:.9f}" for n in numbers) + f" {name}.png {name}_R.png 2 1 0")
    return "\n".join(rows) + "\n"


@pytest.mark.slow
@pytest.mark.parametrize(("poses_of", "true"), [("format", True), ("rectified", False)])
def test_a_raw_cameras_navigation_gives_the_true_reef(
    tmp_path: Path, poses_of: str, true: bool
) -> None:
    frames = ReefFrames(SurveySpec(pairs=6, lines=2, image_size=(240, 192)), noise_px=0.05)
    T = Rectification.from_rig(toed_in_rig()).T_rectified_left
    write_run(tmp_path, frames, frames.pair, T)
    poses = tmp_path / "stereo_pose_est.data"
    poses.write_text(acfr_text(frames.trajectory.names, frames.trajectory.T_world_camera @ T))
    config = RunConfig(mapping=MAPPING.model_copy(update={"poses_of": poses_of, "poses": "given"}))
    fuse(tmp_path, poses, config)
    position = read_cloud(tmp_path / "map" / "cloud.ply")["position"]
    error_m = np.median(np.abs(position[:, 2] - height_at(frames.reef, position)))
    assert error_m < 0.01 if true else error_m > 0.03


def fuse_small(out: Path, poses: Path | None = None) -> survey_map.MapSummary:
    return fuse(out, poses, RunConfig(mapping=CONFIG))


@pytest.fixture
def small_run(tmp_path: Path) -> Path:
    out = tmp_path / "out"
    write_run(out, [flat_frame(i) for i in range(4)], PAIR)
    write_tum(out.with_name("track.tum"), track(4))
    return out


@pytest.mark.slow
@pytest.mark.parametrize(
    ("file", "harm"),
    [
        ("range/f2.tiff", "gone"),
        ("corrected/f2.png", "gone"),
        ("corrected/f2.png", "cut short"),
        ("confidence/f2.png", "of another size"),
    ],
)
def test_a_damaged_frame_is_named_and_the_rest_fused(small_run: Path, file: str, harm: str) -> None:
    path = small_run / file
    if harm == "gone":
        path.unlink()
    elif harm == "cut short":
        path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
    else:
        cv2.imwrite(str(path), np.zeros((9, 9), np.uint8))
    summary = fuse_small(small_run, small_run.with_name("track.tum"))
    assert (summary.frames, summary.placed) == (4, 3)
    assert [frame.name for frame in summary.unplaced] == ["f2"]
    assert "f2" in summary.unplaced[0].reason
    assert "is missing or damaged" in summary.unplaced[0].reason
    assert len(read_cloud(small_run / "map" / "cloud.ply")) > 1000


class Vanishing(Sequence[SurveyFrame]):
    """Frames of which one can be read so many times, and then no more."""

    def __init__(self, frames: Sequence[SurveyFrame], number: int, reads: int) -> None:
        self.frames, self.number, self.reads = frames, number, reads

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, i: int) -> SurveyFrame:  # type: ignore[override]
        if i == self.number:
            self.reads -= 1
            if self.reads < 0:
                raise FrameError(self.frames[i].name, "the disk is gone")
        return self.frames[i]


@pytest.mark.slow
@pytest.mark.parametrize("reads", [0, 1, 2, 6])
def test_a_frame_may_vanish_at_any_moment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, reads: int
) -> None:
    monkeypatch.setattr(kept_frames, "SETTINGS", kept_frames.KeepingSettings(most_bytes=0))
    summary = survey_map.build_map(
        Vanishing([flat_frame(i) for i in range(4)], 1, reads), PAIR, tmp_path, CONFIG, track(4)
    )
    assert [(frame.name, frame.reason) for frame in summary.unplaced] == [
        ("f1", "the disk is gone")
    ]
    assert summary.placed == 3
    assert (tmp_path / "orthomosaic_preview.png").exists()


@pytest.mark.slow
def test_a_frame_may_vanish_while_its_own_track_is_followed() -> None:
    reef = ReefFrames(SurveySpec(pairs=5, lines=1, image_size=(256, 208), seed=3), noise_px=0.1)
    frames = ReadableFrames(Vanishing(list(reef), 2, 1))  # type: ignore[call-overload]
    placement = odometry.solve(
        odometry.follow(Survey(frames, reef.pair, FrameIndex.build(frames, reef.pair))), rounds=0
    )
    assert placement.components.tolist() == [0, 0, -1, 0, 0]
    assert placement.unplaced[0].reason == "the disk is gone"


def test_a_run_of_which_nothing_is_left_is_refused(small_run: Path) -> None:
    for path in (small_run / "range").iterdir():
        path.unlink()
    with pytest.raises(
        MappingError,
        match=r"none of the 4 frames can be read: .*range/f0.tiff: is missing or damaged",
    ):
        fuse_small(small_run)


def test_a_run_of_an_earlier_version_is_refused(small_run: Path) -> None:
    content = json.loads((small_run / "run.json").read_text())
    content["format_version"] = 1
    (small_run / "run.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match="by another version of the program: run again"):
        fuse_small(small_run)


@pytest.mark.slow
def test_two_programs_never_write_one_folder(small_run: Path) -> None:
    poses = small_run.with_name("track.tum")
    with held(small_run), pytest.raises(OutputError):
        fuse_small(small_run, poses)
    assert not (small_run / "map").exists()
    assert fuse_small(small_run, poses).placed == 4
    with held(small_run):
        pass


@pytest.mark.slow
def test_a_run_without_standard_errors_is_fused(small_run: Path, tmp_path: Path) -> None:
    bare = [
        dataclasses.replace(frame, range_std_m=np.full_like(frame.range_m, np.nan))
        for frame in map(flat_frame, range(4))
    ]
    write_run(tmp_path / "bare", bare, PAIR)
    assert not (tmp_path / "bare" / "range_std").exists()
    assert fuse_small(tmp_path / "bare", small_run.with_name("track.tum")).placed == 4
    np.testing.assert_allclose(
        read_cloud(tmp_path / "bare" / "map" / "cloud.ply")["position"][:, 2], 0, atol=1e-3
    )


def test_the_standard_error_of_a_range_is_that_of_its_disparity() -> None:
    range_m = np.full((128, 160), 2.0, np.float32) * PAIR.ray_length
    disparity = PAIR.disparity_from_depth(range_m / PAIR.ray_length)
    off_m = PAIR.range_from_depth(PAIR.depth_from_disparity(disparity - DISPARITY_STD_PX)) - range_m
    np.testing.assert_allclose(PAIR.estimated_range_std_m(range_m), off_m, rtol=0.02)


def test_linear_and_monochrome_images_become_colors_of_the_map() -> None:
    encoded = np.array([[[200, 120, 40]]], np.uint8)
    linear = decode_srgb(encoded.astype(np.float32) / 255)
    np.testing.assert_array_equal(eight_bit(linear + np.float32([0, 0, 0])), encoded)
    np.testing.assert_array_equal(eight_bit(np.float32([[[2.0, -1.0, 1.0]]])), [[[255, 0, 255]]])
    np.testing.assert_array_equal(
        eight_bit(encoded[..., 1].astype(np.uint16) * 257), [[[120, 120, 120]]]
    )


@pytest.mark.slow
def test_a_map_is_replaced_as_a_whole(small_run: Path) -> None:
    poses = small_run.with_name("track.tum")
    broken = track(4)
    broken.T_world_camera[2:, 1, 3] += 50
    write_tum(poses, broken)
    in_two = fuse_small(small_run, poses)
    assert in_two.components == (2, 2) and map_exit_code(in_two) == 3
    assert (small_run / "map" / "piece_1" / "cloud.ply").exists()
    write_tum(poses, track(4))
    summary = fuse_small(small_run, poses)
    assert not (small_run / "map" / "piece_1").exists()
    assert sorted(path.name for path in summary.files) == sorted(
        path.name for path in (small_run / "map").iterdir()
    )


@pytest.mark.slow
def test_a_fusion_that_is_stopped_leaves_the_earlier_map_as_it_was(
    small_run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    poses = small_run.with_name("track.tum")
    fuse_small(small_run, poses)
    before = {path.name: path.read_bytes() for path in (small_run / "map").iterdir()}

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(survey_map, "write_preview", stop)
    with pytest.raises(KeyboardInterrupt):
        fuse(small_run, poses, RunConfig(mapping=CONFIG.model_copy(update={"voxel_m": 0.03})))
    assert {path.name: path.read_bytes() for path in (small_run / "map").iterdir()} == before


@pytest.mark.slow
def test_a_map_without_the_libraries_of_geotiff_says_so(
    small_run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(survey_map.georeference, "available", lambda: False)
    summary = fuse_small(small_run, small_run.with_name("track.tum"))
    assert any(
        "no GeoTIFF of mosaic, terrain and metrics" in warning for warning in summary.warnings
    )
    assert not any(path.suffix == ".tif" for path in summary.files)


def test_a_folder_that_holds_no_run_is_left_as_it_was(tmp_path: Path) -> None:
    with pytest.raises(InputError):
        fuse_small(tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_the_command_names_what_is_missing_and_ends_with_3(
    small_run: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (small_run / "range" / "f2.tiff").unlink()
    poses = small_run.with_name("track.tum")
    monkeypatch.setattr(
        sys,
        "argv",
        [
            "stereo-seecolor",
            "fuse",
            str(small_run),
            "--poses",
            str(poses),
            "--set",
            "mapping.voxel_m=0.02",
        ],
    )
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 3
    printed = capsys.readouterr().out
    assert "not placed: f2: " in printed
    assert "3 of 4 frames fused" in printed
