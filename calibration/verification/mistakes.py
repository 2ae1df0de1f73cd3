"""The usual mistake that explains why a calibration does not fit, tested on raw matches."""

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError
from calibration.geometry import Array
from calibration.refraction import cameras_in_water
from calibration.rig import StereoRig
from calibration.verification.matches import Images, Matches, similar_points
from calibration.verification.mistake_table import EXCHANGED, MISTAKES, RECTIFIED, Flip, Mistake
from calibration.verification.vertical_disparity import RowCheck


@dataclass(frozen=True)
class MistakeLimits:
    """Decides when a mistake explains the images. Distances are medians, from a point to the line
    that the rig expects it on.

    least_points: fewer may be alike by chance. wrong_px: a rig that has drifted is off by a pixel
    or two (0.6 px on a real dive).
    left_px, better: what a mistake may leave, and how many times less than the rig as given: on a
    real dive the right one leaves 0.4 px, others 4 px and more. behind_px, better_behind: the most,
    and how many times less, where the points lie behind the cameras: with a camera that has moved
    too, several mistakes leave a pixel. alike: mistakes within this factor explain the images
    alike, and the more usual is named.
    in_front: of the points. rectified_px: rows of rectified images differ by the noise of the
    points alone, and raw ones of a pair that was built parallel by little more.
    """

    least_points: int = 50
    wrong_px: float = 3.0
    left_px: float = 1.5
    better: float = 4.0
    behind_px: float = 0.8
    better_behind: float = 3.0
    alike: float = 1.2
    in_front: float = 0.8
    rectified_px: float = 0.7


LIMITS = MistakeLimits()


@dataclass(frozen=True, eq=False)
class Fit:
    """The fit of a rig to matched points. off_px: median distance from their epipolar lines.
    in_front: fraction in front of both cameras.
    """

    off_px: float
    in_front: float

    @property
    def is_behind(self) -> bool:
        """Tell whether nearly all points lie behind the cameras."""
        return self.in_front < 1 - LIMITS.in_front

    def explains(self, given: "Fit", most_px: float) -> bool:
        """Whether this fit, off by at most most_px, can be the truth where ``given`` cannot."""
        good = self.off_px < most_px and self.in_front > LIMITS.in_front
        most_behind_px = max(LIMITS.behind_px, given.off_px / LIMITS.better_behind)
        better = given.off_px > max(LIMITS.wrong_px, LIMITS.better * self.off_px)
        return good and (better or (given.is_behind and self.off_px < most_behind_px))


NOTHING = Fit(np.inf, 0.0)
"""What fits no points."""


@dataclass(frozen=True, eq=False)
class FoundMistake:
    """A mistake that explains the images. rig: the calibration without it. line: what was done,
    with its evidence, and what to do.
    """

    mistake: Mistake
    rig: StereoRig
    line: str

    @property
    def exchanged(self) -> bool:
        """Tell whether left and right are exchanged."""
        return self.mistake.what == EXCHANGED


def may_be_wrong(rows: RowCheck) -> bool:
    """Whether rows disagree as no moved camera explains: a mistake should be searched for."""
    return rows.swapped or (rows.row_error_px > LIMITS.wrong_px and not rows.refusal)


def likely_mistake(
    rig: StereoRig, pairs: Iterable[Images], rival: StereoRig | None = None
) -> FoundMistake | None:
    """The mistake that explains raw image pairs, (H, W) or (H, W, C), which the rig as given does
    not. rival: the rig that another cause makes, which the mistake must explain as well as.

    None where the rig may be right, no mistake explains the images, or they show too little.
    """
    if rig.port is not None:
        return None
    fitting = [(left, right) for left, right in pairs if _are_of(rig, left, right)]
    points = Matches.joined([similar_points(left, right) for left, right in fitting])
    given = fit_of(rig, points)
    behind = (
        f"{1 - given.in_front:.0%} of {len(points.left)} points lie behind the cameras, "
        if given.is_behind
        else ""
    )
    as_given = f"{behind}{given.off_px:.1f} px off their epipolar lines as given"
    on_one_side = [one for one in MISTAKES if one.is_mirrored and one.left != one.right]
    others = [one for one in MISTAKES if one not in on_one_side]
    most_px = LIMITS.alike * fit_of(rival, points).off_px if rival else np.inf
    if found := _explaining(rig, points, others, given, as_given, most_px):
        return found
    width = rig.right.image_size[0]
    mirrored = Matches.joined(
        [similar_points(left, np.ascontiguousarray(right[:, ::-1])) for left, right in fitting]
    )
    if len(mirrored.left) < LIMITS.better * len(points.left):
        return None
    back = Matches(mirrored.left, np.abs([width - 1, 0] - mirrored.right))
    as_given = f"{len(points.left)} points match as given, {len(back.left)} with one side mirrored"
    return _explaining(rig, back, on_one_side, NOTHING, as_given)


def _explaining(
    rig: StereoRig,
    points: Matches,
    mistakes: Iterable[Mistake],
    given: Fit,
    as_given: str,
    rival_px: float = np.inf,
) -> FoundMistake | None:
    """The most usual of the mistakes that explain the points about as well as any, if any does and
    leaves no more than rival_px.
    """
    if len(points.left) < LIMITS.least_points:
        return None
    explaining: list[tuple[Fit, Mistake, StereoRig]] = []
    for mistake in mistakes:
        with suppress(CalibrationError):
            without = mistake.make(rig)
            fit = fit_of(without, points, mistake.left, mistake.right)
            most_px = LIMITS.rectified_px if mistake.what == RECTIFIED else LIMITS.left_px
            if fit.off_px <= rival_px and fit.explains(given, most_px):
                explaining.append((fit, mistake, without))
    if not explaining:
        return None
    least_px = min(fit.off_px for fit, *_ in explaining)
    alike = [one for one in explaining if one[0].off_px <= LIMITS.alike * least_px]
    fit, mistake, without = alike[0]
    fix = mistake.fix
    if mistake.is_mirrored and given.is_behind:
        fix += (
            "; the inverse transform of a rig in which a camera has moved since would look the "
            "same, and is a more common mistake"
        )
    if not mistake.is_mirrored and any(other.is_mirrored for _, other, _ in alike):
        fix += "; images mirrored on both sides would look the same: mirror them back if they are"
    line = f"{mistake.what}: {as_given}, {fit.off_px:.1f} px otherwise: {fix}"
    return FoundMistake(mistake, without, line)


def _are_of(rig: StereoRig, left: NDArray[np.generic], right: NDArray[np.generic]) -> bool:
    return left.shape[1::-1] == rig.left.image_size and right.shape[1::-1] == rig.right.image_size


def fit_of(
    rig: StereoRig, points: Matches, left: Flip = (False, False), right: Flip = (False, False)
) -> Fit:
    """Fit matched points of both raw images, some of them wrong, to a rig. left, right: axes of the
    images that run the other way.
    """
    left_camera, right_camera, T = cameras_in_water(rig)
    sides = []
    for camera, pixels, flip, size in (
        (left_camera, points.left, left, rig.left.image_size),
        (right_camera, points.right, right, rig.right.image_size),
    ):
        sides.append(camera.rays(np.where(flip, np.array(size) - 1 - pixels, pixels)))
    reached = np.isfinite(sides[0]).all(axis=1) & np.isfinite(sides[1]).all(axis=1)
    if not reached.any():
        return Fit(np.inf, 0.0)
    rays_left, rays_right = sides[0][reached], sides[1][reached]
    off_px = _off_their_lines(rays_left, rays_right, T) * rig.left.K[0, 0]
    middle_px = float(np.median(off_px))
    best = off_px <= middle_px
    return Fit(middle_px, float(_in_front(rays_left[best], rays_right[best], T).mean()))


def _off_their_lines(left: Array, right: Array, T: Array) -> Array:
    """(n,) Sampson's distance of rays with z = 1 (Hartley and Zisserman 2004, sec. 11.4.3)."""
    x, y, z = T[:3, 3] / np.linalg.norm(T[:3, 3])
    essential = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ T[:3, :3]
    lines_right, lines_left = left @ essential.T, right @ essential
    steepness = np.sqrt(
        (lines_right[:, :2] ** 2).sum(axis=1) + (lines_left[:, :2] ** 2).sum(axis=1)
    )
    return np.asarray(np.abs((right * lines_right).sum(axis=1)) / np.maximum(steepness, 1e-12))


def _in_front(left: Array, right: Array, T: Array) -> NDArray[np.bool_]:
    """(n,) whether the point nearest to both rays lies before both cameras: least squares of z_left
    R left + t = z_right right.
    """
    a, b, t = left @ T[:3, :3].T, right, T[:3, 3]
    aa, bb, ab, at, bt = (a * a).sum(1), (b * b).sum(1), (a * b).sum(1), a @ t, b @ t
    return np.asarray((ab * bt - bb * at > 0) & (aa * bt - ab * at > 0))
