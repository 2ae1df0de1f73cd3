"""Poses that stay while the images move."""

import numpy as np

from calibration.transforms import rotation_vector
from stereo_seecolor.mapping.navigation.corrections import MAX_TURN_RAD
from stereo_seecolor.mapping.navigation.motions import Motions
from stereo_seecolor.mapping.navigation.seen_motion import SeenMotion
from stereo_seecolor.records import Array

MOVES_M, STILL = 0.05, 0.01
"""Where the images move by so much across the vertical, positions that move by so small a
fraction are none: a degree of latitude is 111 km.
"""
STUCK, STUCK_SCATTER = 0.25, 0.5
"""Positions that move by less than this fraction, and of that movement by more than this otherwise
than in the images, stay at one place.
"""
STILL_RAD = 1e-6
"""Attitudes that differ by less are one number."""
ALIKE = (
    "the given attitudes are all equal, and differ from those of the images: if you have only "
    "positions, give only these, as a table with a column map (nav.csv:time=...,lat=...,lon=...)"
)


def still(T_world_camera: Array, seen: SeenMotion, position_step_m: float) -> str:
    """What to say of poses that stay while the images move: numbers that are not positions, or no
    attitudes; "" for others, and for positions rounded to more than the images move.
    """
    motions = Motions.of(T_world_camera, seen.spans or seen.edges)
    given, measured = (shift[:, :2] for shift in motions.shifts_in_world(T_world_camera))
    given_m, measured_m = (np.median(np.linalg.norm(one, axis=1)) for one in (given, measured))
    if measured_m > max(MOVES_M, position_step_m) and given_m < STUCK * measured_m:
        scale = (given * measured).sum() / max((measured**2).sum(), 1e-12)
        unexplained_m = np.median(np.linalg.norm(given - scale * measured, axis=1))
        if unexplained_m > STUCK_SCATTER * given_m or not given_m:
            return (
                f"the given positions hardly move (by {given_m:.2f} m where the images move by "
                f"{measured_m:.2f} m, medians), in other directions: they stay at one place, as "
                "of a sensor that repeats its last fix"
            )
        if given_m < STILL * measured_m:
            return (
                "the given positions hardly move while the images do: are they latitudes and "
                "longitudes, instead of meters?"
            )
    turns_rad = np.linalg.norm(rotation_vector(motions.measured[:, :3, :3]), axis=1)
    return ALIKE if turns_rad.max() > MAX_TURN_RAD and attitudes_equal(T_world_camera) else ""


def attitudes_equal(T_world_camera: Array) -> bool:
    """Whether all known attitudes are equal to the digit: they were not measured."""
    R = T_world_camera[np.isfinite(T_world_camera).all(axis=(1, 2)), :3, :3]
    return len(R) > 1 and float(np.abs(R - R[0]).max()) < STILL_RAD
