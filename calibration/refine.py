"""Estimation of what has moved in a rig since its calibration, from the vertical disparity of a
dive's matches.

Only the right camera is moved, against the left: its rotation and its focal length. A rotation
about the baseline's axis (pitch) and a vertical offset of the principal point look the same to a
fraction of a pixel, and neither changes a range, so both are called pitch here. The position of the
right camera is not estimated: over a scene of one depth, a baseline that points forward looks like
another focal length, and both together fit whatever the lens model has wrong.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from calibration.checks import judge_matches
from calibration.errors import CalibrationError
from calibration.rectification import plan_rectification, rectified_points, upright_rotations
from calibration.refinement import Movement, Refinement
from calibration.refraction import cameras_in_water
from calibration.resampling import jackknife, no_worse
from calibration.rig import StereoRig, quarter_turn
from calibration.transforms import rigid_transform
from calibration.verification.conventions import settle_matches
from calibration.verification.matches import Matches, rectified_matches
from calibration.verification.rigid_motion import SeenTwice
from calibration.verification.row_fits import row_inliers

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RefineLimits:
    """Decides what is estimated, and when that is refused."""

    # a pair left out must leave two, or errors of one pair (a swell between two shutters) pass for
    # the rig's
    min_pairs: int = 3
    # of a pair: fewer do not reach the corners of the image, where roll and scale show
    min_matches: int = 30
    # of a pair, spread evenly: more cost time, and a pair's errors are alike anyway
    max_matches: int = 400
    folds: int = 10  # parts left out in turn, as in calibrate
    # where the loss turns from squares to absolute values: matches are good to 0.1 px
    noise_px: float = 0.15


LIMITS = RefineLimits()
PARAMETERS = ("pitch", "roll", "scale", "yaw")
"""Angles in radians; scale: logarithm of the right focal length over its calibrated one."""
SCALE_STEP = 1e-3  # of the derivative of rays by the scale
# simplest first; yaw last, since it moves ranges
MODELS = tuple(PARAMETERS[:count] for count in range(1, len(PARAMETERS) + 1))


class HiddenCauseError(CalibrationError):
    """What makes ranges wrong is no movement of a camera, and a refined rig would hide it."""


def refine_matches(
    rig: StereoRig, raw: Sequence[Matches], couples: Sequence[SeenTwice] = ()
) -> StereoRig:
    """The rig with what has moved estimated from matches in raw pixels of image pairs of a dive.

    Twelve pairs spread over the dive are enough. The rig's ``refinement`` says what has moved, with
    standard errors.

    The simplest of four models is taken whose vertical disparity on pairs left out of the fit is no
    worse than the best's; the calibration stays as it is where it is that good itself.

    couples: points of neighboring pairs, whose motion tells causes apart that rows do not.

    Raises CalibrationError for fewer than three pairs with matches, and HiddenCauseError where a
    calibration made in air, other lenses or another mode explain rows and motion.
    """
    rig = settle_matches(rig, raw)
    kept = [_usable(rig, matches) for matches in raw]
    kept = [matches for matches in kept if len(matches.left) >= LIMITS.min_matches]
    if len(kept) < LIMITS.min_pairs:
        raise CalibrationError(
            f"{len(kept)} of {len(raw)} pairs show at least {LIMITS.min_matches} points in both "
            f"images, and {LIMITS.min_pairs} are "
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
    fits = [_Fit.of(rig, kept, names) for names in ((), *MODELS)]
    best = min(fits, key=lambda fit: float(fit.squares.mean()))
    chosen = next(fit for fit in fits if fit is best or no_worse(fit.squares, best.squares))
    refinement = Refinement(
        movements=tuple(
            Movement(name, float(chosen.values[PARAMETERS.index(name)]), float(std))
            for name, std in chosen.errors()
        ),
        before_px=float(
            np.median(np.abs(np.concatenate([_residuals(rig, matches) for matches in kept])))
        ),
        after_px=float(np.median(np.abs(chosen.left_out))),
        pairs=len(kept),
        matches=sum(len(matches.left) for matches in kept),
        focal_px=float(plan_rectification(rig).pair.focal_px),
    )
    return replace(moved_rig(rig, chosen.values) if chosen.names else rig, refinement=refinement)


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
    """A model fitted to all pairs, and to all but a part of them in turn.

    values: (4,) fitted; partial: (folds, 4) fitted without a part. left_out: (n,) vertical
    disparities of matches by the fit without their pair, pixels; squares: (pairs,) their mean loss
    over each pair, which tells a keystone in the corners as a median does not.
    """

    names: tuple[str, ...]
    values: Array
    partial: Array
    left_out: Array
    squares: Array

    @classmethod
    def of(cls, rig: StereoRig, pairs: list[Matches], names: tuple[str, ...]) -> "_Fit":
        values = _solve(rig, pairs, names)
        folds = min(LIMITS.folds, len(pairs))
        number = np.arange(len(pairs)) % folds
        partial, rest = [], [np.zeros(0)] * len(pairs)
        for fold in range(folds):
            without = _solve(
                rig,
                [pair for pair, out in zip(pairs, number == fold, strict=True) if not out],
                names,
                values,
            )
            partial.append(without)
            for i in np.flatnonzero(number == fold):
                rest[i] = _residuals(moved_rig(rig, without), pairs[i])
        squares = np.array([_loss(errors).mean() for errors in rest])
        return cls(names, values, np.array(partial), np.concatenate(rest), squares)

    def errors(self) -> list[tuple[str, float]]:
        """Each parameter's name and standard error."""
        errors = jackknife(self.partial)
        return [(name, float(errors[PARAMETERS.index(name)])) for name in self.names]


def _loss(errors_px: Array) -> Array:
    """That of the fit, by which a mismatch counts little."""
    return np.asarray(2 * (np.sqrt(1 + (errors_px / LIMITS.noise_px) ** 2) - 1))


def _solve(
    rig: StereoRig, pairs: list[Matches], names: tuple[str, ...], start: Array | None = None
) -> Array:
    """(4,) values of least vertical disparity; those not named are 0."""
    values = np.zeros(len(PARAMETERS))
    if not names:
        return values
    free = [PARAMETERS.index(name) for name in names]
    disparity = _disparity_of(rig, pairs)

    def residuals(x: Array) -> Array:
        values[free] = x
        return disparity(values)

    first = np.zeros(len(free)) if start is None else start[free]
    values[free] = least_squares(
        residuals, first, x_scale=1e-3, loss="soft_l1", f_scale=LIMITS.noise_px
    ).x
    return values


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
    if len(left) < LIMITS.min_matches:
        return raw
    kept = np.flatnonzero(row_inliers(left, right, plan_rectification(rig).matching_pair))
    kept = kept[:: -(-len(kept) // LIMITS.max_matches) or 1]
    return Matches(raw.left[kept], raw.right[kept])
