"""A constant rotation between the camera and the poses' axes: a mount angle that was forgotten, or
other camera axes.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from stereo_seecolor.config import MountConfig
from stereo_seecolor.geometry import nearest_rotation, rotation_vector
from stereo_seecolor.mapping.navigation.motions import Motions

Array = NDArray[np.float64]


@dataclass(frozen=True)
class TurnSettings:
    """When a rotation is used."""

    # standard error before anything is measured, 10 degrees: decides what the motion leaves open
    prior_rad: float = 0.17
    min_rad: float = 0.026  # 1.5 degrees: less is an installation's tolerance
    # of its own standard error, which neighbors' common noise makes up to two times too small
    min_sigmas: float = 6.0
    rounds: int = 5  # of weighting by the residuals
    floor_m: float = 0.002  # least standard error of a shift and
    floor_rad: float = 0.001  # of a turn: what the pictures can tell


TURN_SETTINGS = TurnSettings()


@dataclass(frozen=True, eq=False)
class Turn:
    """R: (3, 3), T_world_camera = T_given R. std_rad: (3,) standard errors about the camera's
    axes.
    """

    R: Array
    std_rad: Array

    @property
    def angle_deg(self) -> float:
        """The angle of the rotation, degrees."""
        return float(np.degrees(np.linalg.norm(rotation_vector(self.R))))

    @property
    def believed(self) -> bool:
        """Tell whether the rotation is large and significant."""
        vector = rotation_vector(self.R)
        return bool(
            np.linalg.norm(vector) > TURN_SETTINGS.min_rad
            and (np.abs(vector) / self.std_rad).max() > TURN_SETTINGS.min_sigmas
        )


def constant_turn(motions: Motions) -> Turn:
    """The turn X with given X = X measured for all motions, by their shifts and their turns
    (hand-eye calibration).

    Tsai and Lenz (1989), IEEE Trans. Robotics and Automation 5(3), for a pure turn: both the shift
    and the rotation vector of a motion are turned by X, so that X is the solution of Wahba's
    problem; what the motion leaves open stays as it is.
    """
    shifts = motions.given[:, :3, 3], motions.measured[:, :3, 3]
    turns = rotation_vector(motions.given[:, :3, :3]), rotation_vector(motions.measured[:, :3, :3])
    R, prior = np.eye(3), np.eye(3) / TURN_SETTINGS.prior_rad**2
    for _ in range(TURN_SETTINGS.rounds):
        correlation, information = prior.copy(), prior.copy()
        for (given, measured), floor in (
            (shifts, TURN_SETTINGS.floor_m),
            (turns, TURN_SETTINGS.floor_rad),
        ):
            off = np.linalg.norm(given - measured @ R.T, axis=1)
            # median of the length of a 3-D Gaussian
            sigma = max(floor, float(np.median(off)) / 1.54)
            weight = 1 / (sigma**2 * (1 + (off / (3 * sigma)) ** 2))
            correlation += np.einsum("n,ni,nj->ij", weight, given, measured)
            outer = np.einsum("n,ni,nj->ij", weight, measured, measured)
            information += np.trace(outer) * np.eye(3) - outer
        R = nearest_rotation(correlation)
    return Turn(R, np.sqrt(np.diag(np.linalg.inv(information))))


def mount_with(turn: Turn, mount: MountConfig) -> str:
    """The settings of the mount that would take the turn in: Rz(yaw) Ry(pitch) Rx(roll) R."""
    now = Rotation.from_euler("xyz", mount.rpy_deg, degrees=True)
    roll, pitch, yaw = (now * Rotation.from_matrix(turn.R)).as_euler("xyz", degrees=True)
    return f"mapping.mount.rpy_deg=[{roll:.1f},{pitch:.1f},{yaw:.1f}]"
