"""Export for BIIGLE: corrected images, and the table of metadata that it imports with a volume."""

import csv
from pathlib import Path

import numpy as np

from stereo_seecolor.earth import degrees_from_north_east
from stereo_seecolor.extras.export.export_format import ExportFormat
from stereo_seecolor.extras.export.images_of_8_bits import write_images
from stereo_seecolor.run_folder.posed_run import PosedRun

COLUMNS = (
    "filename",
    "taken_at",
    "lng",
    "lat",
    "gps_altitude",
    "distance_to_ground",
    "area",
    "yaw",
)
"""BIIGLE's names: UTC, degrees, meters (depths negative), square meters, degrees from north."""


def write(posed: PosedRun, folder: Path) -> None:
    """``images/`` and metadata.csv; what is not known stays empty."""
    images = write_images(posed.frames, folder)
    with (folder / "metadata.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for frame, image, T in zip(posed.frames, images, posed.T_map_camera, strict=True):
            taken = frame.taken.strftime("%Y-%m-%d %H:%M:%S") if frame.taken else ""
            writer.writerow(
                [
                    image.name,
                    taken,
                    *_place(posed, T),
                    *_ground(posed, posed.measured_range_m(frame)),
                ]
            )


def _place(posed: PosedRun, T: np.ndarray) -> list[str]:
    """lng, lat, gps_altitude; what is not known is empty."""
    if posed.origin is None:
        return ["", "", ""]
    x_m, y_m, z_m = (float(value) for value in T[:3, 3] + posed.offset_m)
    latitude_deg, longitude_deg = degrees_from_north_east(y_m, x_m, posed.origin)
    altitude = f"{z_m:.3f}" if posed.origin.depth_known else ""
    return [f"{longitude_deg:.9f}", f"{latitude_deg:.9f}", altitude]


def _ground(posed: PosedRun, range_m: np.ndarray) -> list[str]:
    """distance_to_ground, area of the picture at that distance, and no yaw: a camera that looks
    down has none of its own.
    """
    depth_m = posed.geometry.depth_from_range(range_m)
    if not np.isfinite(depth_m).any():
        return ["", "", ""]
    distance_m = float(np.nanmedian(depth_m))
    width, height = posed.geometry.image_size
    return [
        f"{distance_m:.3f}",
        f"{width * height * (distance_m / posed.geometry.focal_px) ** 2:.4f}",
        "",
    ]


FORMAT = ExportFormat(
    "images, and metadata.csv with time, position, distance and area of each", "BIIGLE", write
)
