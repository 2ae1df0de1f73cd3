"""The usual mistakes of a calibration: hypotheses tested on images of the dive."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibration.checks import rows_off_px
from calibration.errors import CalibrationError
from calibration.field_checks.matches import (
    QUICK,
    Images,
    Matches,
    raw_matches,
    rectified_matches,
    similar_points,
)
from calibration.field_checks.vertical_disparity import GIVE_RECTIFIED, RECTIFIED, RowCheck
from calibration.refraction import cameras_in_water
from calibration.rig import Camera, StereoRig

# Search for the usual mistake that explains why a calibration does not fit a dive's images,
# tested on matched points.

Array = NDArray[np.float64]
Flip = tuple[bool, bool]
KEPT, ACROSS, DOWN, TURNED = (False, False), (True, False), (False, True), (True, True)


@dataclass(frozen=True)
class HypothesisLimits:
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


LIMITS = HypothesisLimits()


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
        """Tell whether this fit, off by at most most_px, can be the truth where ``given``
        cannot.
        """
        good = self.off_px < most_px and self.in_front > LIMITS.in_front
        most_behind_px = max(LIMITS.behind_px, given.off_px / LIMITS.better_behind)
        better = given.off_px > max(LIMITS.wrong_px, LIMITS.better * self.off_px)
        return good and (better or (given.is_behind and self.off_px < most_behind_px))


NOTHING = Fit(np.inf, 0.0)
"""What fits no points."""


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A usual mistake. what: was done. fix: what to do. rig: the calibration without it.

    left_flip, right_flip: which axes of a side's images run the other way, x and y: both where they
    were turned by 180 degrees.
    line: says what was done, with its evidence, and what to do. most_px: what the mistake may
    leave.
    """

    what: str
    fix: str
    rig: StereoRig
    left_flip: Flip = KEPT
    right_flip: Flip = KEPT
    line: str = ""
    most_px: float = LIMITS.left_px

    @property
    def exchanged(self) -> bool:
        """Tell whether left and right are exchanged."""
        return self.what == EXCHANGED

    @property
    def is_mirrored(self) -> bool:
        """Tell whether the images are mirrored along one axis."""
        return not {ACROSS, DOWN}.isdisjoint((self.left_flip, self.right_flip))


EXCHANGED = "left and right look swapped"
_EXCHANGE = (
    "exchange --left and --right (of images that show both sides: --set "
    "input.right_half_first=true), or the cameras in the "
    "calibration, if it lists the right one first"
)
_TURN = (
    "turn them as they were when calibrated (or remove their EXIF orientation, if the "
    "calibration was made without it)"
)


def _mistakes(rig: StereoRig) -> Iterator[Hypothesis]:
    """Those that give a rig at all, the most usual first."""
    R, t = rig.T_right_left[:3, :3], rig.T_right_left[:3, 3]
    back = _transform(R.T, -R.T @ t)
    with suppress(CalibrationError):
        yield Hypothesis(
            EXCHANGED, _EXCHANGE, replace(rig, left=rig.right, right=rig.left, T_right_left=back)
        )
    # else a moved camera comes to the same
    distorted = rig.left.distortion.any() and rig.right.distortion.any()
    if distorted and rig.left.image_size == rig.right.image_size:
        yield Hypothesis(
            RECTIFIED, GIVE_RECTIFIED, rectified_like(rig), most_px=LIMITS.rectified_px
        )
    wrong_way = "the translation between the cameras points the wrong way"
    reverse = "use -T, or -R T if it is the place of the right camera"
    transforms = (
        (
            "the transform between the cameras is the inverse one, right to left",
            "invert it (R transposed, T = -R^T T)",
            back,
        ),
        (
            "the rotation between the cameras is transposed",
            "transpose R, and leave T",
            _transform(R.T, t),
        ),
        (wrong_way, reverse, _transform(R, -t)),
        (wrong_way, reverse, _transform(R, -R @ t)),
    )
    for what, fix, T in transforms:
        with suppress(CalibrationError):
            yield Hypothesis(f"{what}, in the calibration", fix, replace(rig, T_right_left=T))
    lenses = "the lenses of left and right are exchanged in the calibration"
    yield Hypothesis(
        lenses,
        "exchange K and distortion, and leave R and T",
        replace(rig, left=rig.right, right=rig.left),
    )
    for sides, left, right in (
        ("left", TURNED, KEPT),
        ("right", KEPT, TURNED),
        ("left and right", TURNED, TURNED),
    ):
        yield Hypothesis(
            f"the {sides} images are turned by 180 degrees against the calibration",
            _TURN,
            rig,
            left,
            right,
        )
    for flip in (ACROSS, DOWN):
        yield _mirrored("left and right", rig, flip, flip)


def rectified_like(rig: StereoRig) -> StereoRig:
    """A rig of rectified images, of this one's baseline; its focal length and center are not those
    of the images.
    """
    camera = Camera(rig.left.K, np.zeros(0), rig.left.image_size)
    along = np.eye(3)[int(np.abs(rig.T_right_left[:2, 3]).argmax())]
    return replace(
        rig,
        left=camera,
        right=camera,
        T_right_left=_transform(
            np.eye(3), np.copysign(rig.baseline_m, rig.T_right_left[:3, 3]) * along
        ),
    )


def _mirrors(rig: StereoRig) -> Iterator[Hypothesis]:
    """One side alone mirrored."""
    for flip in (ACROSS, DOWN):
        yield _mirrored("left", rig, flip, KEPT)
        yield _mirrored("right", rig, KEPT, flip)


def _mirrored(sides: str, rig: StereoRig, left: Flip, right: Flip) -> Hypothesis:
    way = "left to right" if ACROSS in (left, right) else "top to bottom"
    return Hypothesis(
        f"the {sides} images are mirrored, {way}, against the calibration",
        "mirror them back",
        rig,
        left,
        right,
    )


def _transform(R: Array, t: Array) -> Array:
    T: Array = np.eye(4)
    T[:3, :3], T[:3, 3] = R, t
    return T


def may_be_wrong(rows: RowCheck) -> bool:
    """Tell whether rows disagree as no movement of a camera explains, so that a mistake should be
    searched for.
    """
    return rows.swapped or (rows.row_error_px > LIMITS.wrong_px and not rows.refusal)


def likely_hypothesis(rig: StereoRig, pairs: Iterable[Images]) -> Hypothesis | None:
    """The mistake that explains raw image pairs, (H, W) or (H, W, C), which the rig as given does
    not.

    None where the rig may be right, no mistake explains the images, or they show too little.
    """
    if rig.port is not None:
        return None
    fitting = [(left, right) for left, right in pairs if _are_of(rig, left, right)]
    points = _together([similar_points(left, right) for left, right in fitting])
    given = fit_of(Hypothesis("", "", rig), points)
    behind = (
        f"{1 - given.in_front:.0%} of {len(points.left)} points lie behind the cameras, "
        if given.is_behind
        else ""
    )
    if found := _explaining(
        points, _mistakes(rig), given, f"{behind}{given.off_px:.1f} px off their lines as given"
    ):
        return found
    width = rig.right.image_size[0]
    mirrored = _together(
        [similar_points(left, np.ascontiguousarray(right[:, ::-1])) for left, right in fitting]
    )
    if len(mirrored.left) < LIMITS.better * len(points.left):
        return None
    back = Matches(mirrored.left, np.abs([width - 1, 0] - mirrored.right))
    as_given = (
        f"{len(points.left)} points look alike as given and {len(back.left)} with one side mirrored"
    )
    return _explaining(back, _mirrors(rig), NOTHING, as_given)


def _explaining(
    points: Matches, mistakes: Iterator[Hypothesis], given: Fit, as_given: str
) -> Hypothesis | None:
    """The most usual of the mistakes that explain the points about as well as any, if any does."""
    if len(points.left) < LIMITS.least_points:
        return None
    tried = [(mistake, fit_of(mistake, points)) for mistake in mistakes]
    tried = [(mistake, fit) for mistake, fit in tried if fit.explains(given, mistake.most_px)]
    if not tried:
        return None
    least = min(fit.off_px for _, fit in tried)
    alike = [one for one in tried if one[1].off_px <= LIMITS.alike * least]
    mistake, fit = alike[0]
    fix = mistake.fix
    if mistake.is_mirrored and given.is_behind:
        fix += (
            "; the inverse transform of a rig of which a camera has moved since would look the "
            "same, and is the more usual mistake"
        )
    if not mistake.is_mirrored and any(other.is_mirrored for other, _ in alike):
        fix += "; images mirrored on both sides would look the same: mirror them back if they are"
    return replace(
        mistake, line=f"{mistake.what}: {as_given}, {fit.off_px:.1f} px otherwise: {fix}"
    )


def _are_of(rig: StereoRig, left: NDArray[np.generic], right: NDArray[np.generic]) -> bool:
    return left.shape[1::-1] == rig.left.image_size and right.shape[1::-1] == rig.right.image_size


def _together(found: list[Matches]) -> Matches:
    left, right = (
        np.concatenate([np.zeros((0, 2)), *(getattr(one, side) for one in found)])
        for side in ("left", "right")
    )
    return Matches(left, right)


def fit_of(mistake: Hypothesis, points: Matches) -> Fit:
    """Fit matched points of both raw images, some of them wrong, to the rig without that
    mistake.
    """
    rig = mistake.rig
    left_camera, right_camera, T = cameras_in_water(rig)
    sides = []
    for camera, pixels, flip, size in (
        (left_camera, points.left, mistake.left_flip, rig.left.image_size),
        (right_camera, points.right, mistake.right_flip, rig.right.image_size),
    ):
        sides.append(camera.rays(np.where(flip, np.array(size) - 1 - pixels, pixels)))
    reached = np.isfinite(sides[0]).all(axis=1) & np.isfinite(sides[1]).all(axis=1)
    if not reached.any():
        return Fit(np.inf, 0.0)
    left, right = sides[0][reached], sides[1][reached]
    off_px = _off_their_lines(left, right, T) * rig.left.K[0, 0]
    middle_px = float(np.median(off_px))
    best = off_px <= middle_px
    return Fit(middle_px, float(_in_front(left[best], right[best], T).mean()))


def _off_their_lines(left: Array, right: Array, T: Array) -> Array:
    """(n,) Sampson's distance of rays with z = 1 from the epipolar geometry (Hartley and Zisserman
    2004, sec. 11.4.3).
    """
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


# Files that can be read in more than one way: images of the dive decide.

CLEARLY_BETTER = 1.2
"""Readings whose vertical disparities are nearer than this to each other fit alike: the first,
which is the likeliest, is taken.
On synthetic pairs a wrong reading is worse by a factor of two and more, or not told by them at all.
"""


def resolve_convention(rig: StereoRig, pairs: Iterable[Images]) -> StereoRig:
    """The one of a rig's readings whose rows agree best on raw image pairs, and as a doubt how it
    was chosen.

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
    best = next(i for i, error in enumerate(errors_px) if error <= CLEARLY_BETTER * min(errors_px))
    others = ", ".join(f"{error:.1f}" for i, error in enumerate(errors_px) if i != best)
    doubt = (
        f"{readings[best].reading}: this reading fits the images: rows agree to "
        f"{errors_px[best]:.1f} px, otherwise to {others} px"
    )
    return replace(readings[best], alternatives=(), doubts=(*readings[best].doubts, doubt))
