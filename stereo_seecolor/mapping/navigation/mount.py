"""A mount that was forgotten: a constant turn between the camera and the axes of the poses, or a
lever arm to the point whose positions are given. Both show where the camera turns.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from calibration.robust_statistics import weighted_median_and_error
from calibration.transforms import nearest_rotation, rotation_from_vector, rotation_vector
from stereo_seecolor.config import MountConfig
from stereo_seecolor.mapping.navigation.motions import LEAST_EDGES, Motions
from stereo_seecolor.mapping.track.relative_pose import Edge
from stereo_seecolor.records import Array


@dataclass(frozen=True)
class MountSettings:
    """When a turn or an arm is used."""

    # standard errors before anything is measured: they decide what the motion leaves open
    prior_rad: float = 0.17  # 10 degrees
    prior_m: float = 1.0
    least_rad: float = 0.026  # 1.5 degrees: less is an installation's tolerance
    least_m: float = 0.1  # less is no more than navigation's noise
    # of its own standard error, in the direction that is known best, which neighbors' common noise
    # makes up to two times too small
    sigmas: float = 6.0
    # of the shifts' residuals, rms and median, an arm must leave at most this fraction: noise of
    # positions stays
    left: float = 0.5
    north_sigmas: float = 5.0  # of the angle between headings and positions
    rounds: int = 5  # of weighting by the residuals
    # least standard errors of a shift and of a turn: what the images can tell
    floor_m: float = 0.002
    floor_rad: float = 0.001


SETTINGS = MountSettings()


@dataclass(frozen=True, eq=False)
class Turn:
    """R: (3, 3), T_world_camera = T_given R. std_rad: (3,) errors about the camera's axes."""

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
            np.linalg.norm(vector) > SETTINGS.least_rad
            and (np.abs(vector) / self.std_rad).max() > SETTINGS.sigmas
        )


def constant_turn(motions: Motions) -> Turn:
    """The turn X with given X = X measured for all motions, by their shifts and their turns
    (hand-eye calibration).

    Tsai and Lenz (1989), IEEE Trans. Robotics and Automation 5(3), for a pure turn: both the shift
    and the rotation vector of a motion are turned by X, so that X is the solution of Wahba's
    problem; what the motion leaves open stays as it is.
    """
    shifts = motions.given[:, :3, 3], motions.measured[:, :3, 3]
    turns = _turns(motions.given), _turns(motions.measured)
    R, prior = np.eye(3), np.eye(3) / SETTINGS.prior_rad**2
    for _ in range(SETTINGS.rounds):
        correlation, information = prior.copy(), prior.copy()
        for (given, measured), floor in ((shifts, SETTINGS.floor_m), (turns, SETTINGS.floor_rad)):
            weight = _weights(given - measured @ R.T, floor)
            correlation += np.einsum("n,ni,nj->ij", weight, given, measured)
            outer = np.einsum("n,ni,nj->ij", weight, measured, measured)
            information += np.trace(outer) * np.eye(3) - outer
        R = nearest_rotation(correlation)
    return Turn(R, np.sqrt(np.diag(np.linalg.inv(information))))


@dataclass(frozen=True)
class North:
    """By how much headings are turned against motions, radians, clockwise from above."""

    angle_rad: float
    std_rad: float

    @property
    def believed(self) -> bool:
        """Tell whether the angle is large and significant."""
        return abs(self.angle_rad) > max(SETTINGS.least_rad, SETTINGS.north_sigmas * self.std_rad)

    def undone(self, T_world_camera: Array) -> Array:
        """The poses with headings that fit their positions."""
        result = T_world_camera.copy()
        back = rotation_from_vector(np.array([0.0, 0.0, self.angle_rad]))
        result[:, :3, :3] = back @ T_world_camera[:, :3, :3]
        return result


def north_of(T_world_camera: Array, edges: Sequence[Edge]) -> North:
    """Find the angle between headings and positions; unlike a turn of the camera on its vehicle it
    does not turn what the camera sees of its own rotation.
    """
    motions = Motions.of(T_world_camera, edges)
    if not motions.edges:
        return North(0.0, np.inf)
    given, measured = (shift[:, :2] @ [1, 1j] for shift in motions.shifts_in_world(T_world_camera))
    across = given * np.conj(measured)
    middle = np.angle(across.sum())
    angles, weights = np.angle(across * np.exp(-1j * middle)), np.abs(measured) ** 2
    # each frame is in several edges
    beside, std_rad = weighted_median_and_error(angles, weights, motions.frames / 2)
    return North(float(middle + beside), std_rad)


def mount_with(turn: Turn, mount: MountConfig) -> str:
    """The settings of the mount that would take the turn in: Rz(yaw) Ry(pitch) Rx(roll) R."""
    now = Rotation.from_euler("xyz", mount.rpy_deg, degrees=True)
    roll, pitch, yaw = (now * Rotation.from_matrix(turn.R)).as_euler("xyz", degrees=True)
    return f"mapping.mount.rpy_deg=[{roll:.1f},{pitch:.1f},{yaw:.1f}]"


def lever_arm(motions: Motions) -> tuple[Array, Array] | None:
    """Estimate the vector from the camera to the point whose positions are given, (3,) in the
    camera's axes, and its standard errors (3,), meters; None where it is not significant.

    motions: over spans, where the camera turns the most, if they are known. A point at l moves by
    t + (R - I) l where the camera moves by R, t.
    """
    off_m = motions.given[:, :3, 3] - motions.measured[:, :3, 3]
    turns = motions.measured[:, :3, :3] - np.eye(3)
    arm_m, covariance = np.zeros(3), np.eye(3)
    for _ in range(SETTINGS.rounds):
        weight = _weights(off_m - turns @ arm_m, SETTINGS.floor_m)
        covariance = np.linalg.inv(
            np.einsum("n,nki,nkj->ij", weight, turns, turns) + np.eye(3) / SETTINGS.prior_m**2
        )
        arm_m = covariance @ np.einsum("n,nki,nk->i", weight, turns, off_m)
    arms = turns @ arm_m
    before_m, after_m = np.linalg.norm(off_m, axis=1), np.linalg.norm(off_m - arms, axis=1)
    # on straight lines an arm moves nothing: it is judged where it does
    shows = np.linalg.norm(arms, axis=1) > np.median(after_m)
    explains = np.count_nonzero(shows) >= LEAST_EDGES and np.median(
        after_m[shows]
    ) < SETTINGS.left * np.median(before_m[shows])
    sure = np.sqrt(arm_m @ np.linalg.inv(covariance) @ arm_m) > SETTINGS.sigmas
    believed = explains and sure and np.linalg.norm(arm_m) > SETTINGS.least_m
    return (arm_m, np.sqrt(np.diag(covariance))) if believed else None


def _turns(motion: Array) -> Array:
    """(n, 3) axes of rotations, times the sines of their angles: half a turn, whose axis has no
    sign, counts nothing.
    """
    off = motion[:, :3, :3] - np.swapaxes(motion[:, :3, :3], 1, 2)
    return np.stack([off[:, 2, 1], off[:, 0, 2], off[:, 1, 0]], axis=1) / 2


def _weights(off: Array, floor: float) -> Array:
    """(n,) inverse variances of residuals (n, 3), less for those that are far off."""
    lengths = np.linalg.norm(off, axis=1)
    sigma = max(floor, float(np.median(lengths)) / 1.54)  # of the length of a 3-D Gaussian
    return np.asarray(1 / (sigma**2 * (1 + (lengths / (3 * sigma)) ** 2)))
