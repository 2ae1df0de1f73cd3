"""Image pairs of a target -> StereoRig and CalibrationReport."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from calibration.boards.bundle import Array, Bundle, Lens, rms, solve
from calibration.boards.changes import Change, change_midway
from calibration.boards.figures import RangePlaces
from calibration.boards.lens import fit_rig, to_camera
from calibration.boards.outlying_views import DISAGREE, view_errors, without_outliers
from calibration.boards.report import MAX_FOCAL_STD, CalibrationReport, LensScore, ViewReport
from calibration.boards.shifted_pairs import refuse_out_of_step
from calibration.boards.target_shape import TargetShape, target_shape
from calibration.boards.target_views import TargetView, common_ids, observations_of, usable_views
from calibration.boards.targets import Target
from calibration.errors import CalibrationError
from calibration.rectification import rectified_points
from calibration.resampling import NEGLIGIBLE, jackknife, no_worse
from calibration.rig import Medium, StereoRig
from calibration.rig_errors import RigErrors

LENSES = (Lens("pinhole", 5), Lens("fisheye", 4), Lens("pinhole", 8))  # simplest first
# parts of the views that are left out in turn, to choose a lens model: each fit keeps nine tenths
# of them
FOLDS = 10
# of a rig that is written, or a 500th of the width: corners are found to 0.2 px, blurred ones to
# one
MOST_ERROR_PX = 3.0
MIN_VIEWS_FOR_CHOICE = 5  # too few views for cross-validation: the simplest model is taken


def calibrate(
    views: Sequence[TargetView], target: Target, medium: Medium = "water"
) -> tuple[StereoRig, CalibrationReport]:
    """Calibrate a rig from detected views.

    Views that fit badly are dropped with the reason; the lens model is the simplest that predicts
    left-out views as well as the best one does.

    Raises CalibrationError if fewer than three views show the target in both images, if left and
    right are out of step, or if they give no rig that can be.
    """
    refuse_out_of_step(views, target)
    usable, dropped = usable_views(views)
    size = usable[0].image_size
    shape = change = None
    kept, outliers, fits = without_outliers(usable, target, LENSES[:2])
    if len(kept) >= MIN_VIEWS_FOR_CHOICE:
        fits += [fit_rig(kept, target, lens) for lens in LENSES[2:]]
    else:
        fits = fits[:1]
    fitted = observations_of(kept, target)
    errors_px = np.array([rms(fit, fitted) for fit in fits])
    simplest = int(np.argmax(errors_px <= (1 + NEGLIGIBLE / 2) * errors_px.min()))
    places = RangePlaces.of(fits[simplest], size)
    scores = [_cross_validate(fit, kept, target, places) for fit in fits]
    bundle, score = _choose(fits, scores)
    if len(kept) >= MIN_VIEWS_FOR_CHOICE:
        fits.append(
            solve(
                replace(bundle, lens=replace(bundle.lens, square_pixels=False)),
                fitted,
            )
        )
        scores.append(_cross_validate(fits[-1], kept, target, places))
        bundle, score = _choose([bundle, fits[-1]], [score, scores[-1]])
        widened = _with_choice_of_lens(score, scores)
        # views that leave the focal length open leave the shape open, too; those that give no rig
        # are refused below
        if widened.relative_std[:2].max() <= MAX_FOCAL_STD[1]:
            with suppress(np.linalg.LinAlgError):
                shape = target_shape(bundle, fitted, target)
                widened = _with_shape(widened, shape, places)
        with suppress(np.linalg.LinAlgError):
            change = _change(usable, kept, outliers, bundle, shape, target)
        if change:
            widened, shape = _with_change(widened, change, places), None
        scores = [widened if other is score else other for other in scores]
        score = widened
    try:
        rig = _rig(bundle, size, medium)
        rig = replace(rig, rms_px=rms(bundle, fitted), errors=_errors(score))
        _refuse_nonsense(rig, score)
    except CalibrationError as error:
        raise CalibrationError(
            f"the {len(kept)} views give an impossible rig ({error}): "
            + (
                change.text
                if change
                else "check whether the cameras moved or zoomed between pairs, and whether pairs "
                "were exposed at the same moment, and tilt the target more"
            )
        ) from error
    report = _report(bundle, rig, kept, target, scores, score)
    return rig, replace(
        report, views=(*report.views, *dropped, *outliers), shape=shape, change=change
    )


def _cross_validate(
    full: Bundle, views: list[TargetView], target: Target, places: RangePlaces
) -> LensScore:
    """Fit without every tenth view in turn, from ``full`` on, and predict the views left out, but
    for the target's pose.
    """
    folds = min(FOLDS, len(views))
    squares = np.zeros(len(views))
    rows, fits = [], []
    for fold in range(folds):
        left_out = np.arange(len(views)) % folds == fold
        train = [view for view, out in zip(views, left_out, strict=True) if not out]
        test = [view for view, out in zip(views, left_out, strict=True) if out]
        fitted = solve(
            replace(full, T_left_target=full.T_left_target[~left_out]),
            observations_of(train, target),
        )
        start = replace(fitted, T_left_target=full.T_left_target[left_out])
        posed = solve(start, observations_of(test, target), poses_only=True)
        squares[left_out] = (view_errors(posed, test, target) ** 2).mean(axis=1)
        rows.append(_row_errors(fitted, test))
        fits.append(places.figures(fitted))
    std = jackknife(np.array(fits))
    # views that leave a pose open give no equations
    with suppress(np.linalg.LinAlgError):
        std = np.maximum(std, places.least_squares_std(full, observations_of(views, target)))
    return LensScore(full.lens, squares, np.concatenate(rows), places.figures(full), std)


def _with_choice_of_lens(score: LensScore, scores: list[LensScore]) -> LensScore:
    """``score``, its errors widened by how far other lens models that predict as well lie."""
    best = min(scores, key=lambda other: other.rms_px)
    alike = [
        other
        for other in scores
        if no_worse(other.squares, best.squares) and np.isfinite(other.row_error_px)
    ]
    spread = np.max([np.abs(other.figures - score.figures) for other in [score, *alike]], axis=0)
    return replace(score, std=np.hypot(score.std, spread), spread=spread)


def _with_shape(score: LensScore, shape: TargetShape, places: RangePlaces) -> LensScore:
    """``score``, its errors widened by what the target's shape changes."""
    change = np.abs(places.figures(shape.fit) - score.figures)
    change[2:] = np.hypot(change[2:], shape.scale_error * score.figures[2:])
    return replace(score, std=np.hypot(score.std, change))


def _change(
    usable: list[TargetView],
    kept: list[TargetView],
    outliers: list[ViewReport],
    bundle: Bundle,
    shape: TargetShape | None,
    target: Target,
) -> Change | None:
    """What changed midway, by the kept views and by those whose sides contradict the rig of most:
    a camera that was moved may have put out all that follow.
    """
    moved = {view.name for view in outliers if str(view.reason).startswith(DISAGREE)}
    views = [view for view in usable if view in kept or view.name in moved]
    names = [view.name for view in views]
    fitted = observations_of(views, target)
    if not moved:
        return change_midway(bundle, fitted, names, shape)
    return change_midway(fit_rig(views, target, bundle.lens), fitted, names)


def _with_change(score: LensScore, change: Change, places: RangePlaces) -> LensScore:
    """``score``, its errors widened by how far the rigs before and after lie."""
    apart = [np.abs(places.figures(fit) - score.figures) for fit in change.fits]
    return replace(score, std=np.hypot(score.std, np.max(apart, axis=0)))


def _rig(bundle: Bundle, image_size: tuple[int, int], medium: Medium) -> StereoRig:
    left, right = (
        to_camera(bundle.lens.model, intrinsics, image_size) for intrinsics in bundle.intrinsics
    )
    return StereoRig(left, right, bundle.T_right_left, medium)


def _refuse_nonsense(rig: StereoRig, score: LensScore) -> None:
    """Raise CalibrationError for a rig that its own views contradict."""
    limit_px = max(MOST_ERROR_PX, rig.left.image_size[0] / 500)
    if not (rig.rms_px is not None and rig.rms_px < limit_px and score.row_error_px < limit_px):
        raise CalibrationError(
            f"rms {rig.rms_px:.1f} px, rows {score.row_error_px:.1f} px apart after "
            f"rectification, baseline {rig.baseline_m:.3g} m"
        )


def _errors(score: LensScore) -> RigErrors:
    focal, baseline = score.relative_std[:2].max(), score.relative_std[2]
    # of a length in nine tenths of the image, where lenses are less certain than focal lengths
    lens = np.sqrt(max(score.range_std**2 - baseline**2, 0.0))
    return RigErrors(float(max(focal, lens)), float(baseline), "stereo-seecolor calibrate")


def _row_errors(bundle: Bundle, views: list[TargetView]) -> Array:
    """(n,) left minus right row of common corners, rectified, pixels; NaN where that fails."""
    pixels = []
    for corners in ([view.left for view in views], [view.right for view in views]):
        side = [(own, common_ids(view)) for own, view in zip(corners, views, strict=True)]
        pixels.append(
            np.concatenate(
                [own.pixels[np.searchsorted(own.ids, ids)] for own, ids in side if own is not None]
            )
        )
    try:
        left, right = rectified_points(_rig(bundle, views[0].image_size, "water"), *pixels)
    except CalibrationError:
        return np.array([np.nan])
    return left[:, 1] - right[:, 1]


def _choose(fits: list[Bundle], scores: list[LensScore]) -> tuple[Bundle, LensScore]:
    """The simplest lens whose left-out errors are no worse than the best's."""
    best = min(scores, key=lambda score: score.rms_px)
    reached = any(np.isfinite(score.row_error_px) for score in scores)
    for fit, score in zip(fits, scores, strict=True):
        if score is best or (
            no_worse(score.squares, best.squares)
            and (np.isfinite(score.row_error_px) or not reached)
        ):
            return fit, score
    raise AssertionError("the best is among them")


def _report(
    bundle: Bundle,
    rig: StereoRig,
    views: list[TargetView],
    target: Target,
    scores: list[LensScore],
    score: LensScore,
) -> CalibrationReport:
    errors = view_errors(bundle, views, target).tolist()
    sides = [[o for o in observations_of(views, target) if o.side == side] for side in (0, 1)]
    return CalibrationReport(
        rig=rig,
        scores=tuple(scores),
        lens=score,
        views=tuple(
            ViewReport(view.name, *error) for view, error in zip(views, errors, strict=True)
        ),
        rms_left_px=rms(bundle, sides[0]),
        rms_right_px=rms(bundle, sides[1]),
        corners_left=np.concatenate([o.pixels for o in sides[0]]),
        corners_right=np.concatenate([o.pixels for o in sides[1]]),
    )
