"""ORCA processed_images.csv: ``image_name,image_path,timestamp_utc,latitude,longitude,heading_deg,depth_m``."""

from datetime import UTC, datetime

import numpy as np

from stereo_seecolor.config import MountConfig
from stereo_seecolor.inputs.trajectories.table import Lines, Table
from stereo_seecolor.inputs.trajectories.vehicle import camera_trajectory
from stereo_seecolor.records import Trajectory


def recognizes(lines: Lines) -> bool:
    """A header with image_name and latitude."""
    header = lines.first.lower().split(",")
    return "image_name" in header and "latitude" in header


def read(lines: Lines, mount: MountConfig) -> Trajectory:
    """A level vehicle; a depth of zero or less is unknown, and a frame without depth or heading has no pose."""
    header = [name.strip().lower() for name in lines.first.split(",")]
    table = Table.read(lines, ",", header, lines.content[1:])
    depth_m = np.array(table.column("depth_m", np.nan))
    attitude_deg = np.zeros((len(table.rows), 3))
    attitude_deg[:, 2] = table.column("heading_deg", np.nan)
    return camera_trajectory(
        tuple(table.text("image_name")),
        np.array([_seconds(text) for text in table.text("timestamp_utc")]),
        np.array(table.column("latitude")),
        np.array(table.column("longitude")),
        np.where(depth_m > 0, depth_m, np.nan),
        attitude_deg,
        mount,
    )


def _seconds(text: str) -> float:
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        return float("nan")
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
