"""Estimation of what has moved in a rig since its calibration, from vertical disparity on a dive.

Only the right camera is moved, against the left: its rotation and its focal length. A rotation
about the baseline's axis (pitch) and a vertical offset of the principal point look the same to a
fraction of a pixel, and neither changes a range, so both are called pitch here. The position of the
right camera is not estimated: over a scene of one depth, a baseline that points forward looks like
another focal length, and both together fit whatever the lens model has wrong.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from calibration.checks import judge_matches
from calibration.errors import CalibrationError
from calibration.geometry import Array
from calibration.movement_prior import Weighed
from calibration.rectification import plan_rectification, rectified_points, upright_rotations
from calibration.refinement import Movement, Refinement
from calibration.refraction import cameras_in_water
from calibration.resampling import jackknife_covariance, no_worse
from calibration.rig import StereoRig, quarter_turn
from calibration.transforms import rigid_transform
from calibration.verification.conventions import settle_matches
from calibration.verification.matches import Matches, rectified_matches
from calibration.verification.rigid_motion import SeenTwice
from calibration.verification.row_fits import row_inliers

# a pair left out must leave two, or errors of one pair (a swell between two shutters) pass for the
# rig's
MIN_PAIRS = 3
# of a pair: fewer do not reach the corners of the image, where roll and scale show
MIN_MATCHES = 30
# of a pair, spread evenly: more cost time, and a pair's errors are alike anyway
MAX_MATCHES = 400
FOLDS = 10  # parts left out in turn, as in calibrate
# columns of the image, and rows of each, that are left out in turn: what a lens model has wrong is
# the same in all pairs
PLACES = 3
NOISE_PX = 0.15  # where the loss turns from squares to absolute values: matches are good to 0.1 px
PARAMETERS = ("pitch", "roll", "scale", "yaw")
"""Angles in radians; scale: logarithm of the right focal length over its calibrated one."""
SCALE_STEP = 1e-3  # of the derivative of rays by the scale


class HiddenCauseError(CalibrationError):
    """What makes ranges wrong is no movement of a camera, and a refined rig would hide it."""


def refine_matches(
    rig: StereoRig, raw: Sequence[Matches], couples: Sequence[SeenTwice] = ()
) -> StereoRig:
    """The rig with what has moved estimated from matches in raw pixels of image pairs of a dive.

    Twelve pairs are enough. The rig's ``refinement`` says what has moved, with standard errors.

    All parameters are estimated, each as far as rows outweigh the given calibration. The
    calibration stays as it is where pairs left out of the fit agree better with it.

    couples: points of neighboring pairs, whose motion tells causes apart that rows do not.

    Raises CalibrationError for fewer than three pairs with matches, and HiddenCauseError where a
    calibration made in air, other lenses or another mode explain rows and motion.
    """
    rig = settle_matches(rig, raw)
    kept = [_usable(rig, matches) for matches in raw]
    kept = [matches for matches in kept if len(matches.left) >= MIN_MATCHES]
    if len(kept) < MIN_PAIRS:
        raise CalibrationError(
            f"{len(kept)} of {len(raw)} pairs show at least {MIN_MATCHES} points in both "
            f"images, and {MIN_PAIRS} are "
            "needed to refine a calibration: give more pairs with texture"
        )
    check = judge_matches(rig, rectified_matches(rig, kept), couples)
    if check.refusal or check.no_rig:
        raise CalibrationError(check.advice[0])
    if check.air_in_water or check.cut_out or check.is_lens:
        raise HiddenCauseError(
            f"{check.advice[-1]}; a refined rig would fit the rows with a wrong yaw, and ranges "
            "would be wrong"
        )
    fit = _Fit.of(rig, kept)
    before = [_residuals(rig, matches) for matches in kept]
    is_used = no_worse(_squares(fit.left_out), _squares(before))
    refinement = Refinement(
        movements=tuple(
            Movement(name, float(value), float(std))
            for name, value, std in zip(PARAMETERS, fit.values, fit.std, strict=True)
        )
        if is_used
        else (),
        before_px=float(np.median(np.abs(np.concatenate(before)))),
        after_px=float(np.median(np.abs(np.concatenate(fit.left_out)))),
        pairs=len(kept),
        matches=sum(len(matches.left) for matches in kept),
        focal_px=float(plan_rectification(rig).pair.focal_px),
    )
    return replace(moved_rig(rig, fit.values) if is_used else rig, refinement=refinement)


def moved_rig(rig: StereoRig, values: Array) -> StereoRig:
    """The rig with its right camera turned about its center. values: (4,), see PARAMETERS."""
    to_matching = plan_rectification(rig).R_right_matching
    turn = rigid_transform(to_matching.T @ _turn(values) @ to_matching, np.zeros(3))
    K = rig.right.K.copy()
    K[:2, :2] *= np.exp(values[2])
    return replace(
        rig,
        right=replace(rig.right, K=K),
        T_right_left=turn @ rig.T_right_left,
        rms_px=None,
        refinement=None,
    )


def _turn(values: Array) -> Array:
    pitch, roll, _, yaw = values
    return Rotation.from_rotvec([pitch, yaw, roll]).as_matrix()


@dataclass(frozen=True, eq=False)
class _Fit:
    """All parameters fitted to all pairs, as far as rows outweigh what is known before.

    values, std: (4,). left_out: of each pair the vertical disparities (n,) of its matches by the
    fit without it, pixels.
    """

    values: Array
    std: Array
    left_out: list[Array]

    @classmethod
    def of(cls, rig: StereoRig, pairs: list[Matches]) -> "_Fit":
        values = _solve(rig, pairs)
        number = np.arange(len(pairs)) % FOLDS
        without = [
            _solve(
                rig, [pair for pair, fold in zip(pairs, number, strict=True) if fold != k], values
            )
            for k in range(number.max() + 1)
        ]
        by_place = [_solve(rig, rest, values) for rest in _without_places(pairs)]
        errors = jackknife_covariance(np.array(without)) + jackknife_covariance(np.array(by_place))
        weighed = Weighed.of(values, errors, _pixel(rig))
        left_out = [
            _residuals(moved_rig(rig, weighed.gain @ without[fold]), pair)
            for pair, fold in zip(pairs, number, strict=True)
        ]
        return cls(weighed.gain @ values, weighed.std, left_out)


def _pixel(rig: StereoRig) -> Array:
    """(4,) how much of each parameter moves the corner of the image by a pixel."""
    focal_px, corner_px = rig.left.K[1, 1], np.hypot(*rig.left.image_size) / 2
    return 1 / np.array([focal_px, corner_px, corner_px, focal_px])


def _without_places(pairs: list[Matches]) -> Iterator[list[Matches]]:
    """The pairs without the matches of one part of the image, for each part in turn."""
    pixels = np.concatenate([pair.left for pair in pairs])
    ends = np.cumsum([len(pair.left) for pair in pairs])[:-1]
    for column in np.array_split(np.argsort(pixels[:, 0]), PLACES):
        for place in np.array_split(column[np.argsort(pixels[column, 1])], PLACES):
            kept = np.ones(len(pixels), np.bool_)
            kept[place] = False
            yield [
                Matches(pair.left[some], pair.right[some])
                for pair, some in zip(pairs, np.split(kept, ends), strict=True)
            ]


def _squares(left_out: list[Array]) -> Array:
    """(pairs,) mean loss over each pair, that of the fit, by which a mismatch counts little; it
    tells a keystone in the corners as a median does not.
    """
    return np.array([2 * (np.sqrt(1 + (rows / NOISE_PX) ** 2) - 1).mean() for rows in left_out])


def _solve(rig: StereoRig, pairs: list[Matches], start: Array | None = None) -> Array:
    """(4,) values of least vertical disparity."""
    first = np.zeros(len(PARAMETERS)) if start is None else start
    found = least_squares(
        _disparity_of(rig, pairs), first, x_scale=1e-3, loss="soft_l1", f_scale=NOISE_PX
    )
    return np.asarray(found.x)


def _disparity_of(rig: StereoRig, pairs: list[Matches]) -> Callable[[Array], Array]:
    """The vertical disparities of all matches as a function of the values, their rays computed
    once; linear in the scale.
    """
    left, right, T = cameras_in_water(rig)
    to_matching = plan_rectification(rig).R_right_matching
    rays_left = left.rays(np.concatenate([pair.left for pair in pairs]))
    pixels_right = np.concatenate([pair.right for pair in pairs])
    rays_right = right.rays(pixels_right)
    _, scaled, _ = cameras_in_water(moved_rig(rig, np.array([0, 0, SCALE_STEP, 0])))
    by_scale = (scaled.rays(pixels_right) - rays_right) / SCALE_STEP

    def disparity(values: Array) -> Array:
        turn = rigid_transform(to_matching.T @ _turn(values) @ to_matching, np.zeros(3))
        return _row_difference(turn @ T, rays_left, rays_right + by_scale * values[2]) * float(
            rig.left.K[1, 1]
        )

    return disparity


def _residuals(rig: StereoRig, matches: Matches) -> Array:
    """(n,) right minus left row of raw matches after rectification, in left pixels."""
    left, right, T = cameras_in_water(rig)
    return _row_difference(T, left.rays(matches.left), right.rays(matches.right)) * float(
        rig.left.K[1, 1]
    )


def _row_difference(T_right_left: Array, rays_left: Array, rays_right: Array) -> Array:
    """(n,) right minus left slope across the baseline of rays (n, 3) in each camera's axes; 0 where
    a lens does not reach.
    """
    R_left, R_right, turns = upright_rotations(T_right_left)
    turn = quarter_turn(-turns)
    _, y_left, z_left = turn @ R_left @ rays_left.T
    _, y_right, z_right = turn @ R_right @ rays_right.T
    return np.asarray(np.nan_to_num(y_right / z_right - y_left / z_left))


def _usable(rig: StereoRig, raw: Matches) -> Matches:
    """Matches whose rows differ as their neighbors' do, at most so many as count."""
    left, right = rectified_points(rig, raw.left, raw.right)
    if len(left) < MIN_MATCHES:
        return raw
    kept = np.flatnonzero(row_inliers(left, right, plan_rectification(rig).matching_pair))
    kept = kept[:: -(-len(kept) // MAX_MATCHES) or 1]
    return Matches(raw.left[kept], raw.right[kept])
