"""Image pairs of a target -> StereoRig and CalibrationReport."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from calibration.boards.bundle import Array, Bundle, CornerObservation, Lens, rms, solve
from calibration.boards.lens import fit_camera, fit_rig, target_pose, to_camera
from calibration.boards.outlying_views import view_errors, without_outliers
from calibration.boards.report import CalibrationReport, LensScore, ViewReport
from calibration.boards.target_views import TargetView, common_ids, observations_of, usable_views
from calibration.boards.targets import Target
from calibration.errors import CalibrationError
from calibration.field_checks.matches import jackknife, no_worse
from calibration.geometry import inverse_transform
from calibration.rectification import rectified_points
from calibration.rig import Camera, Medium, RigErrors, StereoRig

# Pairs of a target of which one side lost images: the left image of one pair belongs to the
# right image of another.

MOST_STEPS = 5  # images that one side may have lost
# between two pairs' estimates of the rig; a board moves by more from view to view
SAME_TURN = np.radians(1.5)
SAME_PLACE = 0.1  # of the board's extent
LEAST_FITTING = 5  # pairs, and a third of all, that fit another partner before that is believed
LENS = Lens("pinhole", 5)


def refuse_out_of_step(views: Sequence[TargetView], target: Target) -> None:
    """Raise CalibrationError where most left images fit the right images of other pairs, with
    which, and from where on.

    By the rig between the cameras that each left image and each right image a few pairs before or
    after it would have: that of true partners is always the same.
    """
    cameras = [_camera(views, side, target) for side in (0, 1)]
    if cameras[0] is None or cameras[1] is None:
        return
    tried = [
        (number, step)
        for step in range(-MOST_STEPS, MOST_STEPS + 1)
        for number in range(len(views))
    ]
    rigs = {
        at: T
        for at in tried
        if (T := _rig_of_pair(views, *at, (cameras[0], cameras[1]), target)) is not None
    }
    if not rigs:
        return
    extent_m = float(np.ptp(target.points_m, axis=0).max())
    alike = _alike(np.array(list(rigs.values())), SAME_PLACE * extent_m)
    agreeing = [
        at for at, fits in zip(rigs, alike[alike.sum(axis=1).argmax()], strict=True) if fits
    ]
    fitting = {step: {number for number, of in agreeing if of == step} for _, step in agreeing}
    own = fitting.pop(0, set())
    found = {number: step for step, numbers in fitting.items() for number in numbers - own}
    if len(found) < max(LEAST_FITTING, len(views) / 3) or len(found) <= len(own):
        return
    steps = sorted([*found.items(), *((number, 0) for number in own)])
    changes = [
        (number, step)
        for (_, before), (number, step) in pairwise([(-1, 0), *steps])
        if step != before
    ]
    places = "; ".join(
        f"from {views[number].name} on {_partner(step)} fits" for number, step in changes[:4]
    )
    lost = "left" if changes[0][1] > 0 else "right"
    raise CalibrationError(
        f"left and right images are out of step: {places}: the {lost} side lacks images: remove "
        "the others' that have no partner"
    )


def _partner(step: int) -> str:
    if not step:
        return "its own right image"
    pairs = "pair" if abs(step) == 1 else "pairs"
    return f"the right image {abs(step)} {pairs} {'later' if step > 0 else 'earlier'}"


def _camera(views: Sequence[TargetView], side: int, target: Target) -> Camera | None:
    """One camera, fitted alone; None where too few views show the target."""
    seen = [found for view in views if (found := (view.left, view.right)[side]) is not None]
    if len(seen) < LEAST_FITTING:
        return None
    observations = [
        CornerObservation(number, 0, target.points_m[own.ids], own.pixels)
        for number, own in enumerate(seen)
    ]
    try:
        return to_camera(
            "pinhole",
            fit_camera(LENS, observations, views[0].image_size).intrinsics[0],
            views[0].image_size,
        )
    except CalibrationError:
        return None


def _rig_of_pair(
    views: Sequence[TargetView],
    number: int,
    step: int,
    cameras: tuple[Camera, Camera],
    target: Target,
) -> Array | None:
    """(4, 4) from left to right axes if the left image of a pair and the right one ``step`` pairs
    later were of one moment.
    """
    if not 0 <= number + step < len(views):
        return None
    left, right = views[number].left, views[number + step].right
    if left is None or right is None:
        return None
    sides = (cameras[0], left), (cameras[1], target.same_labels(left, right))
    poses = [
        target_pose(camera, CornerObservation(0, 0, target.points_m[own.ids], own.pixels))
        for camera, own in sides
    ]
    return poses[1] @ inverse_transform(poses[0])


def _alike(rigs: Array, same_place_m: float) -> NDArray[np.bool_]:
    """(n, n) which of the rigs (n, 4, 4) are the same."""
    R, t = rigs[:, :3, :3].reshape(-1, 9), rigs[:, :3, 3]
    same_turn = np.cos(SAME_TURN) < (R @ R.T - 1) / 2
    return np.asarray(same_turn & (np.linalg.norm(t[:, None] - t, axis=2) < same_place_m))


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
    kept, outliers, fits = without_outliers(usable, target, LENSES[:2])
    if len(kept) >= MIN_VIEWS_FOR_CHOICE:
        fits += [fit_rig(kept, target, lens) for lens in LENSES[2:]]
    else:
        fits = fits[:1]
    scores = [_cross_validate(fit, kept, target) for fit in fits]
    bundle, score = _choose(fits, scores)
    if len(kept) >= MIN_VIEWS_FOR_CHOICE:
        fits.append(
            solve(
                replace(bundle, lens=replace(bundle.lens, square_pixels=False)),
                observations_of(kept, target),
            )
        )
        scores.append(_cross_validate(fits[-1], kept, target))
        bundle, score = _choose([bundle, fits[-1]], [score, scores[-1]])
        widened = _with_choice_of_lens(score, scores)
        scores = [widened if other is score else other for other in scores]
        score = widened
    try:
        rig = _rig(bundle, size, medium)
        rig = replace(rig, rms_px=rms(bundle, observations_of(kept, target)), errors=_errors(score))
        _refuse_nonsense(rig, score)
    except CalibrationError as error:
        raise CalibrationError(
            f"the {len(kept)} views give no rig that can be ({error}): see whether the folders are "
            "swapped, whether pairs were taken at one moment, and tilt the target more"
        ) from error
    report = _report(bundle, rig, kept, target, scores, score)
    return rig, replace(report, views=(*report.views, *dropped, *outliers))


def _cross_validate(full: Bundle, views: list[TargetView], target: Target) -> LensScore:
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
        fits.append(_figures(fitted))
    return LensScore(
        full.lens, squares, np.concatenate(rows), _figures(full), jackknife(np.array(fits))
    )


def _figures(bundle: Bundle) -> Array:
    """(3,) focal length left and right (mean of fx and fy), pixels, and baseline, meters."""
    return np.array(
        [
            *(lens[:2].mean() for lens in bundle.intrinsics),
            np.linalg.norm(bundle.T_right_left[:3, 3]),
        ]
    )


def _with_choice_of_lens(score: LensScore, scores: list[LensScore]) -> LensScore:
    """``score``, its standard errors widened by how far other lens models that predict as well lie
    from it.
    """
    best = min(scores, key=lambda other: other.rms_px)
    alike = [
        other
        for other in scores
        if no_worse(other.squares, best.squares) and np.isfinite(other.row_error_px)
    ]
    spread = np.max(
        [np.abs(other.figures - score.figures) for other in alike] or [np.zeros(3)], axis=0
    )
    return replace(score, std=np.hypot(score.std, spread), spread=spread)


def _rig(bundle: Bundle, image_size: tuple[int, int], medium: Medium) -> StereoRig:
    left, right = (
        to_camera(bundle.lens.model, intrinsics, image_size) for intrinsics in bundle.intrinsics
    )
    return StereoRig(left, right, bundle.T_right_left, medium)


def _refuse_nonsense(rig: StereoRig, score: LensScore) -> None:
    """Raise CalibrationError for a rig that its own views contradict: pairs of other moments,
    another target than was said.
    """
    limit_px = max(MOST_ERROR_PX, rig.left.image_size[0] / 500)
    if not (rig.rms_px is not None and rig.rms_px < limit_px and score.row_error_px < limit_px):
        raise CalibrationError(
            f"rms {rig.rms_px:.1f} px, rows {score.row_error_px:.1f} px apart after "
            f"rectification, baseline {rig.baseline_m:.3g} m"
        )


def _errors(score: LensScore) -> RigErrors | None:
    relative = score.std / score.figures
    known = np.isfinite(relative).all()
    return (
        RigErrors(float(relative[:2].max()), float(relative[2]), "stereo-seecolor calibrate")
        if known
        else None
    )


def _row_errors(bundle: Bundle, views: list[TargetView]) -> Array:
    """(n,) left minus right row of the corners in common after rectification, pixels; NaN if that
    cannot be rectified.
    """
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
