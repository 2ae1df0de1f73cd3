"""ORCA's processed_images.csv:
``image_name,image_path,timestamp_utc,latitude,longitude,heading_deg,depth_m``.
"""

import numpy as np

from stereo_seecolor.config import MountConfig
from stereo_seecolor.inputs.trajectories.table import Lines, Table
from stereo_seecolor.inputs.trajectories.times import seconds
from stereo_seecolor.inputs.trajectories.trajectory_format import TextFormat
from stereo_seecolor.inputs.trajectories.vehicle_track import VehicleTrack, from_degrees, step_of
from stereo_seecolor.records import Trajectory


def recognizes(lines: Lines) -> bool:
    """A header with image_name, latitude, and the time and depth of ORCA."""
    return {"image_name", "latitude", "timestamp_utc", "depth_m"} <= {
        *lines.first.lower().split(",")
    }


def read(lines: Lines, mount: MountConfig) -> Trajectory:
    """A level vehicle; without a positive depth or a heading a frame has no pose."""
    header = [name.strip().lower() for name in lines.first.split(",")]
    table = Table.read(lines, ",", header, lines.content[1:])
    depth_m = np.array(table.column("depth_m", np.nan))
    attitude_deg = np.zeros((len(table.rows), 3))
    attitude_deg[:, 2] = table.column("heading_deg", np.nan)
    north_east_m, origin = from_degrees(
        np.array(table.column("latitude")), np.array(table.column("longitude"))
    )
    times = np.array([_seconds_or_nan(text) for text in table.text("timestamp_utc")])
    depth_m = np.where(depth_m > 0, depth_m, np.nan)
    names, step_m = tuple(table.text("image_name")), step_of(table.text("latitude"))
    return VehicleTrack(names, times, north_east_m, depth_m, attitude_deg, origin, step_m).camera(
        mount
    )


def _seconds_or_nan(text: str) -> float:
    try:
        return seconds(text)
    except ValueError:
        return float("nan")


FORMAT = TextFormat("ORCA", recognizes, read)
