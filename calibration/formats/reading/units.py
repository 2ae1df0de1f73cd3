"""Units of translations: meters are inferred from the baseline where the file does not say, and a
doubt becomes a warning.
"""

import numpy as np

from calibration.formats.reading.aliases import METERS
from calibration.geometry import Array
from calibration.rig import MAX_BASELINE_M, MIN_BASELINE_M, Camera, StereoRig
from calibration.transforms import rigid_transform

GUESSES = (
    ("meters", 1.0, 0.0),
    ("millimeters", 1e-3, 0.02),
    ("centimeters", 1e-2, 0.0),
    ("millimeters", 1e-3, 0.0),
)
"""Units in the order in which they are tried, and the shortest baseline in meters: 10 is a rig of
10 cm rather than of 10 mm.
"""


def to_meters(translation: Array, stated: str | None) -> tuple[Array, tuple[str, ...]]:
    """Convert a translation (3,) to meters; return it with a warning, if its unit is doubtful.

    stated: the unit that the file names, None where it names none. Where the baseline in that unit
    cannot be (under 5 mm or over 2 m), those of GUESSES are tried. Left as it is where none of them
    fits: the rig then refuses it with its number.
    """
    length = float(np.linalg.norm(np.clip(translation, -1e9, 1e9)))
    named = METERS.get((stated or "").strip().lower())
    if named is not None and _possible(length * named):
        return translation * named, ()
    for unit, factor, least_m in GUESSES:
        if _possible(length * factor) and length * factor >= least_m:
            reason = (
                f"the file says {stated}, but a baseline of {length:g} {stated} is impossible"
                if stated
                else f"the file names no unit of the baseline {length:g}"
            )
            squares = ", and not as squares of a board" if unit == "centimeters" else ""
            return translation * factor, (
                f"{reason}: it is read as {unit}{squares}, {length * factor * 1000:.1f} mm",
            )
    return translation * (named or 1.0), ()


def rig_in_meters(
    left: Camera, right: Camera, T: Array, stated: str | None, reading: str = ""
) -> StereoRig:
    """The rig of a transform (4, 4) whose translation is in the file's unit, with its doubts."""
    shift, doubts = to_meters(T[:3, 3], stated)
    return StereoRig(left, right, rigid_transform(T[:3, :3], shift), doubts=doubts, reading=reading)


def _possible(baseline_m: float) -> bool:
    return MIN_BASELINE_M <= baseline_m <= MAX_BASELINE_M
