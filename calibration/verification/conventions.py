"""Calibration files that can be read in more than one way: images of the dive decide."""

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from calibration.checks import rows_off_px
from calibration.errors import CalibrationError
from calibration.rig import StereoRig
from calibration.verification.causes import PENALTY, find_causes
from calibration.verification.matches import QUICK, Images, Matches, raw_matches, rectified_matches

CLEARLY_BETTER = 1.2
"""Readings whose vertical disparities are nearer than this to each other fit alike: the first,
which is the likeliest, is taken.
On synthetic pairs a wrong reading is worse by a factor of two and more, or not told by them at all.
"""

AS_CALIBRATED_PX = 1.0
"""Rows that agree less are not those of the calibrated rig: a shift or an enlargement may fit a
wrong reading better.
"""
FITS = "this reading fits the images"
UNDECIDED = "the images do not decide, and the most common reading is used"


def resolve_convention(rig: StereoRig, pairs: Iterable[Images]) -> StereoRig:
    """The one of a rig's readings whose rows agree best on raw image pairs, and as a doubt how.

    The rig itself where it has no alternatives. Raises CalibrationError if no reading finds enough
    points in both images.
    """
    if not rig.alternatives:
        return rig
    images = list(pairs)
    try:
        return settle_matches(rig, raw_matches(rig, images, QUICK))
    except CalibrationError:  # too few points, which are not all that there are
        return settle_matches(rig, raw_matches(rig, images))


def settle_matches(rig: StereoRig, raw: Sequence[Matches]) -> StereoRig:
    """Choose a reading as resolve_convention does, from matches in raw pixels of each pair."""
    if not rig.alternatives:
        return rig
    readings, errors_px = (rig, *rig.alternatives), []
    failure = CalibrationError("no reading of the calibration fits the images")
    for reading in readings:
        try:
            errors_px.append(rows_off_px(reading, rectified_matches(reading, raw)))
        except CalibrationError as error:
            errors_px.append(np.inf)
            failure = error
    if not np.isfinite(min(errors_px)):
        raise failure
    best, verdict = _by_rows(errors_px)
    if min(errors_px) > AS_CALIBRATED_PX:
        best, verdict = _by_causes(readings, raw, best)
    others_px = [error for i, error in enumerate(errors_px) if i != best]
    doubt = (
        f"{readings[best].reading}: {verdict}: rows agree to {errors_px[best]:.1f} px, "
        f"otherwise to {', '.join(f'{error:.1f}' for error in others_px)} px"
    )
    return replace(readings[best], alternatives=(), doubts=(*readings[best].doubts, doubt))


def _by_rows(errors_px: Sequence[float]) -> tuple[int, str]:
    """Choose the reading whose rows agree best; say how sure that is."""
    best = next(i for i, error in enumerate(errors_px) if error <= CLEARLY_BETTER * min(errors_px))
    others_px = [error for i, error in enumerate(errors_px) if i != best]
    return best, FITS if min(others_px) > CLEARLY_BETTER * errors_px[best] else UNDECIDED


def _by_causes(
    readings: Sequence[StereoRig], raw: Sequence[Matches], usual: int
) -> tuple[int, str]:
    """Choose the reading of which the fewest and best causes explain the rows, where a camera has
    moved or images are of another mode. usual: the one that is taken where they do not decide.
    """
    costs = []
    for reading in readings:
        found = None
        with suppress(CalibrationError):
            found = find_causes(reading, rectified_matches(reading, raw)).best
        costs.append(found.misfit + PENALTY * len(found.causes) if found else np.inf)
    order = np.argsort(costs, kind="stable")
    if not costs[order[1]] > costs[order[0]] + PENALTY:
        return usual, UNDECIDED
    return int(order[0]), "this reading leaves the fewest other faults"
