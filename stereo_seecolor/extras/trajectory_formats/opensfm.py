"""``reconstruction.json`` of OpenSfM and OpenDroneMap: world-to-camera rotation vectors and
translations of shots, meters.
"""

from typing import Literal

import numpy as np

from calibration.bounded_text import load_json
from calibration.transforms import rigid_transform, rotation_from_vector
from stereo_seecolor.config import MountConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.trajectories.table import LARGEST, Lines
from stereo_seecolor.inputs.trajectories.trajectory_format import TextFormat
from stereo_seecolor.records import GeoOrigin, Trajectory


def recognizes(lines: Lines) -> bool:
    """A list of JSON with ``shots``."""
    return lines.first.startswith("[") and any('"shots"' in line for line in lines.all)


def read(lines: Lines, mount: MountConfig) -> Trajectory:
    """The largest reconstruction: east, north, up about its reference; z from the sea if known."""
    try:
        whole = max(load_json("\n".join(lines.all)), key=lambda one: len(one["shots"]))
        shots = whole["shots"]
        vectors, shifts = (
            np.array([shot[key] for shot in shots.values()], dtype=np.float64)
            for key in ("rotation", "translation")
        )
        times = np.array(
            [shot.get("capture_time") or np.nan for shot in shots.values()], dtype=np.float64
        )
        place = whole.get("reference_lla")
        origin = GeoOrigin(float(place["latitude"]), float(place["longitude"])) if place else None
        height_m = float(place.get("altitude", 0.0)) if place else 0.0
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise InputError(
            f"{lines.path}: no shots with a rotation and a translation each ({error!r:.80})"
        ) from error
    if (
        vectors.shape != shifts.shape
        or vectors.shape[1:] != (3,)
        or (np.abs(shifts) > LARGEST).any()
    ):
        raise InputError(
            f"{lines.path}: rotation and translation: expected three numbers a shot, got shape "
            f"{shifts.shape}"
        )
    R_world_camera = np.array([rotation_from_vector(vector).T for vector in vectors]).reshape(
        -1, 3, 3
    )
    centers = -np.einsum("nij,nj->ni", R_world_camera, shifts) + [0, 0, height_m]
    up: Literal["z", "unknown"] = "z" if place else "unknown"
    return Trajectory(
        tuple(map(str, shots)),
        times,
        rigid_transform(R_world_camera, centers),
        up=up,
        origin=origin,
        camera="raw",
    )


FORMAT = TextFormat("reconstruction.json", recognizes, read, is_json=True)
