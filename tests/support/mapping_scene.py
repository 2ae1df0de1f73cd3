"""A reef with known truth as the map's stages see it: frames with exact colors and ranges of known
noise, without stereo.
"""

from collections.abc import Iterable, Sequence
from functools import cached_property, lru_cache
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration import Camera, RectifiedPair, StereoRig
from calibration.formats import native
from stereo_seecolor.commands.fuse import fuse
from stereo_seecolor.compute.names import Names
from stereo_seecolor.compute.threads import Threads
from stereo_seecolor.config import MappingConfig, RunConfig
from stereo_seecolor.extras.synthetic import survey
from stereo_seecolor.extras.synthetic.casting import cast, look_up
from stereo_seecolor.extras.synthetic.reef import CELL_M, Reef, build_reef
from stereo_seecolor.extras.synthetic.survey import SurveySpec
from stereo_seecolor.files.encode import encode_confidence, encode_image, encode_map
from stereo_seecolor.files.ply import VERTEX
from stereo_seecolor.files.png import encode_codes
from stereo_seecolor.files.tum import write_tum
from stereo_seecolor.records import SurveyFrame, Trajectory
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.frame_table import RunSummary
from stereo_seecolor.run_folder.layout import RIG, product_path
from stereo_seecolor.run_folder.manifest import StageRecord
from stereo_seecolor.run_folder.ownership import FolderRequest, Owner
from stereo_seecolor.run_folder.reports import RunDescription, close_run, write_reports

PAIR = RectifiedPair(200.0, 80.0, 80.0, 64.0, 0.1, (160, 128))
DOWN = np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]])
CONFIG = MappingConfig(voxel_m=0.02, tile_m=1.0, mosaic_m=0.02, dem_m=0.02, metrics_m=0.5)


def flat_frame(
    i: int,
    altitude_m: float = 1.5,
    color: tuple[int, int, int] = (200, 120, 40),
    fish: bool = False,
) -> SurveyFrame:
    depth_m = np.full((128, 160), altitude_m, np.float32)
    rgb = np.full((128, 160, 3), color, np.uint8)
    if fish:
        depth_m[50:70, 60:100] = 0.6 * altitude_m
        rgb[50:70, 60:100] = (255, 0, 255)
    range_m = depth_m * PAIR.ray_length
    return SurveyFrame(
        f"f{i}", float(i), rgb, range_m, 0.004 * range_m**2, np.full(range_m.shape, 255, np.uint8)
    )


def track(count: int, altitude_m: float = 1.5, step_m: float = 0.3) -> Trajectory:
    T = np.tile(np.eye(4), (count, 1, 1))
    T[:, :3, :3] = DOWN
    T[:, 0, 3], T[:, 2, 3] = np.arange(count) * step_m, altitude_m
    return Trajectory(tuple(f"f{i}" for i in range(count)), np.arange(count, dtype=float), T)


def write_run(
    out: Path,
    frames: Iterable[SurveyFrame],
    pair: RectifiedPair,
    T_rectified_left: NDArray | None = None,
) -> None:
    """What a run leaves of the frames in its folder, as far as the map reads it."""
    T = np.eye(4) if T_rectified_left is None else T_rectified_left
    names = []
    with RunFolder(out, FolderRequest(Owner("stereo", {}))) as folder:
        folder.dive.begin({"range": "range settings", "corrected": "color settings"})
        for frame in frames:
            names.append(frame.name)
            save_frame(folder, frame)
        folder.dive.set_waters(dict.fromkeys(names, "water"))
        rectification = SimpleNamespace(pair=pair, T_rectified_left=T)
        run = RunDescription({}, RunConfig(), Names(names), "corrected", rectification)  # type: ignore[arg-type]
        folder.dive.write(RIG, native.to_bytes(rig_of(pair)))
        close_run(folder, run, True, Threads(1))
        write_reports(folder, run, RunSummary([]))


def flat_frames(count: int) -> list[SurveyFrame]:
    return [flat_frame(i) for i in range(count)]


def write_map(out: Path, frames: Sequence[SurveyFrame], poses: str = "given") -> Path:
    """The run of frames that were taken on ``track``, fused; its folder."""
    write_run(out, frames, PAIR)
    write_tum(out.with_name("nav.tum"), track(len(frames)))
    fuse(
        out, out.with_name("nav.tum"), RunConfig(mapping=CONFIG.model_copy(update={"poses": poses}))
    )
    return out


def rig_of(pair: RectifiedPair) -> StereoRig:
    """A rig whose images are rectified as they are."""
    centers = (pair.cx_left_px, pair.cx_right_px)
    left, right = (
        np.array([[pair.focal_px, 0, cx], [0, pair.focal_px, pair.cy_px], [0, 0, 1]])
        for cx in centers
    )
    T = np.eye(4)
    T[0, 3] = -pair.baseline_m
    return StereoRig(
        Camera(left, np.zeros(0), pair.image_size), Camera(right, np.zeros(0), pair.image_size), T
    )


def save_frame(folder: RunFolder, frame: SurveyFrame) -> None:
    name, mask = frame.name, np.zeros(frame.range_m.shape, np.uint8)
    ranges = {
        "range": encode_map(frame.range_m),
        "confidence": encode_confidence(frame.confidence / np.float32(255)),
    }
    if np.isfinite(frame.range_std_m).any():  # else as of range maps given without it
        ranges["range_std"] = encode_map(frame.range_std_m)
    colors = {"corrected": encode_image(frame.color, "png"), "mask": encode_codes(mask)}
    record = folder.frames.record(name, frame.timestamp_s, {}, (0, 1))
    for stage, record_of_stage, contents in (
        ("range", StageRecord("key", "range settings"), ranges),
        ("corrected", StageRecord("key", "color settings", "water"), colors),
    ):
        files = {
            product: (product_path(product, name, "png"), content)
            for product, content in contents.items()
        }
        record = folder.frames.save(record.with_stage(stage, record_of_stage), stage, files)  # type: ignore[arg-type]


def read_cloud(path: Path) -> NDArray[np.void]:
    content = path.read_bytes()
    header, body = content.split(b"end_header\n", 1)
    count = int(header.split(b"element vertex ")[1].split()[0])
    return np.frombuffer(body, VERTEX, count)


@lru_cache(maxsize=4)
def reef_of(spec: SurveySpec) -> Reef:
    """The reef of a survey, to be read only: several tests fly over the same."""
    return build_reef(spec)


class ReefFrames(Sequence[SurveyFrame]):
    """A survey's frames, made when asked for. noise_px: standard deviation of the disparity,
    correlated over a few pixels.
    """

    def __init__(self, spec: SurveySpec, noise_px: float = 0.2) -> None:
        width, height = spec.image_size
        self.spec = spec
        self.pair = RectifiedPair(
            0.83 * width, width / 2, width / 2, height / 2, 0.12, spec.image_size
        )
        self.trajectory: Trajectory = survey.track(spec)
        self._noise_px = noise_px

    @cached_property
    def reef(self) -> Reef:
        return reef_of(self.spec)

    def __len__(self) -> int:
        return self.spec.pairs

    def __getitem__(self, index: int) -> SurveyFrame:  # type: ignore[override]
        if not 0 <= index < len(self):
            raise IndexError(index)
        rays = self._rays
        T = self.trajectory.T_world_camera[index]
        range_m = cast(self.reef, T, rays)
        linear = look_up(self.reef, T, rays, range_m, 1 / self.pair.focal_px)[:, :, 0]
        rng = np.random.default_rng([self.spec.seed, index])
        color = 255 * np.clip(linear, 0, 1) ** (1 / 2.2) + rng.normal(0, 2, linear.shape)
        depth_m = range_m[..., 0] / self.pair.ray_length
        std_m = (
            depth_m
            * range_m[..., 0]
            / (self.pair.focal_px * self.pair.baseline_m)
            * max(self._noise_px, 0.01)
        )
        noise = cv2.GaussianBlur(rng.standard_normal(std_m.shape).astype(np.float32), (0, 0), 1.5)
        noisy_m = range_m[..., 0] + (noise / noise.std() * std_m if self._noise_px else 0)
        return SurveyFrame(
            name=self.trajectory.names[index],
            timestamp_s=float(self.trajectory.timestamps_s[index]),
            color=np.clip(np.rint(color), 0, 255).astype(np.uint8),
            range_m=noisy_m.astype(np.float32),
            range_std_m=std_m.astype(np.float32),
            confidence=np.full(std_m.shape, 255, np.uint8),
        )

    @cached_property
    def _rays(self) -> NDArray[np.float32]:
        width, height = self.pair.image_size
        column, row = np.meshgrid(np.arange(width), np.arange(height))
        rays = np.stack(
            [
                (column - self.pair.cx_left_px) / self.pair.focal_px,
                (row - self.pair.cy_px) / self.pair.focal_px,
                np.ones_like(row),
            ],
            -1,
        )
        return (rays / np.linalg.norm(rays, axis=-1, keepdims=True))[:, :, None].astype(np.float32)


def height_at(reef: Reef, points_m: NDArray[np.floating]) -> NDArray[np.float32]:
    """True height of the reef below points (N, 2 or more)."""
    column = ((points_m[:, 0] - reef.origin_m[0]) / CELL_M).astype(np.float32)
    row = ((points_m[:, 1] - reef.origin_m[1]) / CELL_M).astype(np.float32)
    heights = [
        cv2.remap(reef.height_m, c, r, cv2.INTER_LINEAR)
        for c, r in zip(
            np.array_split(column, 1 + len(column) // 30000),
            np.array_split(row, 1 + len(row) // 30000),
            strict=True,
        )
    ]
    return np.concatenate([h.ravel() for h in heights])
