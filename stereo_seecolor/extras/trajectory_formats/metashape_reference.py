"""Metashape's exported reference (text): a photo a line, coordinates and yaw, pitch, roll."""

import numpy as np

from stereo_seecolor.config import MountConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.trajectories.table import Lines, Table
from stereo_seecolor.inputs.trajectories.trajectory_format import TextFormat
from stereo_seecolor.inputs.trajectories.vehicle_track import VehicleTrack, from_degrees
from stereo_seecolor.records import Trajectory

_AXES = ("x", "y", "z", "yaw", "pitch", "roll")
_SEPARATORS = ("\t", ";", ",")


def recognizes(lines: Lines) -> bool:
    """A commented header that begins with Label and has an x or a longitude."""
    header = _header(lines)
    return bool(header) and header[0] == "label" and "x" in header


def read(lines: Lines, mount: MountConfig) -> Trajectory:
    """Estimated values where the file has them, else the given ones.

    The angles are the camera's own, whatever the mount: all zero looks down with the top of the
    image to the north, yaw turns clockwise, pitch up, roll to starboard, as a vehicle's with a
    camera mounted the usual way (MountConfig's defaults).
    """
    header = _header(lines)
    table = Table.read(lines, _separator(lines), header, lines.content)
    estimated = all(f"{name}_est" in header for name in _AXES)
    if "yaw" not in header:
        raise InputError(
            f"{lines.path}: is a reference of Metashape without yaw, pitch, roll: export the "
            "cameras (File > Export > Export Cameras, Agisoft XML), or the reference with rotation"
        )
    columns = {name: np.array(table.column(f"{name}_est" if estimated else name)) for name in _AXES}
    attitude_deg = np.column_stack([columns[name] for name in ("roll", "pitch", "yaw")])
    north_east_m, origin = np.column_stack([columns["y"], columns["x"]]), None
    if _is_geographic(lines):
        north_east_m, origin = from_degrees(columns["y"], columns["x"])
    times = np.full(len(table.rows), np.nan)
    return VehicleTrack(
        tuple(table.text("label")), times, north_east_m, -columns["z"], attitude_deg, origin
    ).camera(MountConfig())


def _header_line(lines: Lines) -> str:
    return next(
        (
            line.lstrip("# ")
            for line in lines.all[:5]
            if line.lstrip("# ").lower().startswith("label")
        ),
        "",
    )


def _separator(lines: Lines) -> str:
    return max(_SEPARATORS, key=_header_line(lines).count)


def _header(lines: Lines) -> list[str]:
    """Names in lower case, without units; ``X/Longitude`` and its fellows are x, y and z."""
    names = [name.strip().lower() for name in _header_line(lines).split(_separator(lines))]
    return [name.split("/")[0] for name in names]


def _is_geographic(lines: Lines) -> bool:
    """Longitude and latitude, not easting and northing or local meters."""
    system = next((line for line in lines.all[:5] if "CoordinateSystem" in line), "")
    return "GEOGCS" in system and "PROJCS" not in system


FORMAT = TextFormat("Metashape reference", recognizes, read)
