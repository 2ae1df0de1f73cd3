"""Given heights against the images': other sign, other unit, or always the same."""

from calibration.robust_statistics import deviation_about_zero
from stereo_seecolor.mapping.navigation.motions import Motions
from stereo_seecolor.mapping.navigation.seen_motion import SeenMotion
from stereo_seecolor.records import Array

LEAST_PAIRS = 8
"""Fewer do not show a factor."""
LEAST_M = 0.03
"""Rise and fall between frames, robust standard deviation: less is within the errors of a level."""
EXPLAINS = 0.5
"""Of what heights are off, a factor must leave at most so much, and of what they change."""
SAME = 0.2
"""A factor this near to that of a mistake is its: altitudes follow the bottom as well."""
STAYS = 0.1
"""Heights that change by less than this of what the images show stay the same."""
_FACTORS = {
    "heights or altitudes in place of depths": -1.0,
    "depths in feet": 1 / 0.3048,
    "depths in centimeters, or pressures in millibars": 100.0,
    "depths in millimeters": 1000.0,
    "pressures in kilopascals": 10.0,
    "pressures in bars": 0.1,
    "heights or altitudes in place of depths, in feet": -1 / 0.3048,
    "heights or altitudes in place of depths, in centimeters": -100.0,
}


def wrong_depths(T_world_camera: Array, seen: SeenMotion, misfit: float) -> str:
    """What to say of heights that fit times a factor, and then better than what leaves ``misfit``;
    "" for others.
    """
    given_m, measured_m = _rises(T_world_camera, seen)
    if len(given_m) < LEAST_PAIRS or deviation_about_zero(measured_m) < LEAST_M:
        return ""
    factor = float((given_m * measured_m).sum() / (measured_m**2).sum())
    off_m, left_m = (deviation_about_zero(given_m - times * measured_m) for times in (1.0, factor))
    changes_m = abs(factor) * deviation_about_zero(measured_m)
    alike = [of for of, times in _FACTORS.items() if abs(factor / times - 1) < SAME]
    if left_m > EXPLAINS * min(off_m, changes_m) or not alike:
        return ""
    repaired = T_world_camera.copy()
    repaired[:, 2, 3] /= factor
    if seen.misfit(repaired) >= misfit:
        return ""
    return (
        f"the given depths change {factor:+.2f} times as much as in the images, which leaves "
        f"{left_m:.2f} m of {off_m:.2f} m (standard deviations): {alike[0]}"
    )


def constant_depths(T_world_camera: Array, seen: SeenMotion) -> str:
    """What to say of heights that stay while the images rise and sink; "" for others."""
    given_m, measured_m = (deviation_about_zero(one) for one in _rises(T_world_camera, seen))
    if not measured_m > LEAST_M or given_m > STAYS * measured_m:
        return ""
    return (
        f"the given depths hardly change (by {given_m:.3f} m), while the images rise and sink by "
        f"{measured_m:.2f} m (standard deviations): the depth of the map is not known"
    )


def _rises(T: Array, seen: SeenMotion) -> tuple[Array, Array]:
    """How far frames rise, meters, along the given vertical: as given, and in the images."""
    given_m, measured_m = Motions.of(T, seen.spans or seen.edges).shifts_in_world(T)
    return given_m[:, 2], measured_m[:, 2]
