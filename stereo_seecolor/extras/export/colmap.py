"""COLMAP's model, as text and binary, and an images folder: for splat trainers, multi-view stereo,
and COLMAP itself.

Poses are world to camera, quaternions w first, pixels with (0.5, 0.5) in the center of the top left
one (COLMAP, "Output format").
"""

import struct
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from calibration.transforms import quaternion
from stereo_seecolor.extras.export.export_format import ExportFormat, join_numbers
from stereo_seecolor.extras.export.images_of_8_bits import write_images
from stereo_seecolor.extras.export.observed_points import ObservedPoints, observe
from stereo_seecolor.run_folder.posed_run import PosedRun

CENTER_PX = 0.5
UNKNOWN_ERROR = -1
"""Of a point: its observations are projections, which have no reprojection error."""

PINHOLE = 1
"""COLMAP's number of the camera model."""
SEEN = np.dtype([("xy", "<f8", (2,)), ("point", "<u8")])
"""A point that an image sees, in a binary model."""

WITHOUT_TEXT = (
    "only the binary model: the text model ends names at a space, and names of these images hold "
    "spaces"
)

PointTrack = list[tuple[int, int]]
"""The frames that see a point, counted from 1, and its place among what each of them sees."""


def write(posed: PosedRun, folder: Path) -> str | None:
    """``images/`` and ``sparse/0/`` with cameras, images and points3D, each as .txt and .bin; only
    .bin, with a note, for names that text cannot hold.
    """
    model = folder / "sparse" / "0"
    model.mkdir(parents=True)
    names = [image.name for image in write_images(posed.frames, folder)]
    observations = observe(posed)
    tracks = _tracks(observations)
    (model / "cameras.bin").write_bytes(_camera_binary(posed))
    with (model / "images.bin").open("wb") as file:
        file.writelines(_images_binary(posed, names, observations))
    with (model / "points3D.bin").open("wb") as file:
        file.writelines(_points_binary(observations, tracks))
    if any(" " in name for name in names):
        return WITHOUT_TEXT
    (model / "cameras.txt").write_text(_camera_text(posed), encoding="utf-8")
    (model / "images.txt").write_text(_images_text(posed, names, observations), encoding="utf-8")
    (model / "points3D.txt").write_text(_points_text(observations, tracks), encoding="utf-8")
    return None


def _camera_text(posed: PosedRun) -> str:
    g = posed.geometry
    numbers = (g.focal_px, g.focal_px, *posed.principal_point_px)
    return (
        f"# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n1 PINHOLE {g.image_size[0]} "
        f"{g.image_size[1]} {join_numbers(numbers, 9)}\n"
    )


def _images_text(posed: PosedRun, names: Sequence[str], observations: ObservedPoints) -> str:
    lines = [
        "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME",
        "# POINTS2D[] as (X, Y, POINT3D_ID)",
    ]
    rows = zip(names, posed.T_camera_map, observations.of_frame, strict=True)
    for number, (name, T, (points, pixels)) in enumerate(rows, 1):
        x, y, z, w = quaternion(T[:3, :3])
        lines.append(f"{number} {join_numbers((w, x, y, z, *T[:3, 3]), 9)} 1 {name}")
        seen = zip(pixels + CENTER_PX, points + 1, strict=True)
        lines.append(" ".join(f"{column:.2f} {row:.2f} {point}" for (column, row), point in seen))
    return "\n".join(lines) + "\n"


def _points_text(observations: ObservedPoints, tracks: Sequence[PointTrack]) -> str:
    lines = ["# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)"]
    for number, (position, color, track) in enumerate(
        zip(observations.position, observations.color, tracks, strict=True), 1
    ):
        seen = " ".join(f"{image} {point}" for image, point in track)
        place, rgb = join_numbers(position, 9), " ".join(map(str, color))
        lines.append(f"{number} {place} {rgb} {UNKNOWN_ERROR} {seen}")
    return "\n".join(lines) + "\n"


def _tracks(observations: ObservedPoints) -> list[PointTrack]:
    """One for each point."""
    tracks: list[PointTrack] = [[] for _ in observations.position]
    for number, (points, _) in enumerate(observations.of_frame, 1):
        for place, point in enumerate(points.tolist()):
            tracks[point].append((number, place))
    return tracks


def _camera_binary(posed: PosedRun) -> bytes:
    g = posed.geometry
    return struct.pack(
        "<QIiQQ4d", 1, 1, PINHOLE, *g.image_size, g.focal_px, g.focal_px, *posed.principal_point_px
    )


def _images_binary(
    posed: PosedRun, names: Sequence[str], observations: ObservedPoints
) -> Iterator[bytes]:
    yield struct.pack("<Q", len(names))
    rows = zip(names, posed.T_camera_map, observations.of_frame, strict=True)
    for number, (name, T, (points, pixels)) in enumerate(rows, 1):
        x, y, z, w = quaternion(T[:3, :3])
        yield struct.pack("<I7dI", number, w, x, y, z, *T[:3, 3], 1) + name.encode() + b"\0"
        seen = np.zeros(len(points), SEEN)
        seen["xy"], seen["point"] = pixels + CENTER_PX, points + 1
        yield struct.pack("<Q", len(seen)) + seen.tobytes()


def _points_binary(observations: ObservedPoints, tracks: Sequence[PointTrack]) -> Iterator[bytes]:
    yield struct.pack("<Q", len(observations.position))
    rows = zip(observations.position.tolist(), observations.color.tolist(), tracks, strict=True)
    for number, (position, color, track) in enumerate(rows, 1):
        yield struct.pack("<Q3d3BdQ", number, *position, *color, UNKNOWN_ERROR, len(track))
        yield np.array(track, "<u4").tobytes()


FORMAT = ExportFormat(
    "images, their camera and poses, and points with the frames that see them, as a model in "
    "text and binary",
    "COLMAP, gsplat and other splat trainers, OpenMVS",
    write,
)
