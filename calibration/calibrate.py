"""Image pairs of a target -> StereoRig and CalibrationReport."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibration.bundle import Array, Bundle, Observation, rms, solve
from calibration.errors import CalibrationError
from calibration.gray import to_gray
from calibration.lens import fit_camera, to_camera
from calibration.rectification import rectified_points
from calibration.report import CalibrationReport, LensScore, ViewReport
from calibration.rig import CameraModel, Medium, StereoRig, inverse_transform
from calibration.targets import MIN_CORNERS, Corners, Target

Read = Callable[[str], tuple[NDArray[np.generic], NDArray[np.generic]]]
Size = tuple[int, int]
LENSES: tuple[tuple[CameraModel, int], ...] = (("pinhole", 5), ("fisheye", 4), ("pinhole", 8))  # simplest first
FOLDS = 10
MIN_VIEWS = 3
MIN_VIEWS_FOR_CHOICE = 8
NEGLIGIBLE = 0.05  # of a squared error: 2.5 % of an error
OUTLIER_RATIO = 3.0
OUTLIER_MIN_PX = 0.3
SIDES = ("left", "right")


@dataclass(frozen=True, eq=False)
class View:
    """A pair's corners. image_size: (width, height); left, right: None where the target was not found."""

    name: str
    image_size: Size
    left: Corners | None
    right: Corners | None


def detect_views(
    names: Sequence[str], read: Read, target: Target, workers: int = 1, progress: Callable[[str], None] = lambda name: None
) -> list[View]:
    """Find the target in every pair, in ``workers`` threads.

    read: name -> left and right image, (H, W) or (H, W, 3), 8 or 16 bit. progress: called with each name when it is done.
    """

    def detect(name: str) -> View:
        left, right = read(name)
        if left.shape[:2] != right.shape[:2]:
            raise CalibrationError(
                f"{name}: left is {left.shape[1]}x{left.shape[0]} px and right is {right.shape[1]}x{right.shape[0]}"
            )
        corners = [target.detect(to_gray(image)) for image in (left, right)]
        if corners[0] is not None and corners[1] is not None:
            corners[1] = target.same_labels(corners[0], corners[1])
        progress(name)
        return View(name, (left.shape[1], left.shape[0]), corners[0], corners[1])

    with ThreadPoolExecutor(workers) as pool:
        return list(pool.map(detect, names))


def calibrate(views: Sequence[View], target: Target, medium: Medium = "water") -> tuple[StereoRig, CalibrationReport]:
    """Calibrate a rig from detected views.

    Views that fit badly are dropped with the reason; the lens model is the simplest that predicts left-out views as well as the
    best one does.

    Raises CalibrationError if fewer than three views show the target in both images.
    """
    usable, dropped = _usable_views(views)
    size = usable[0].image_size
    kept, outliers = _without_outliers(usable, target)
    candidates = LENSES if len(kept) >= MIN_VIEWS_FOR_CHOICE else LENSES[:1]
    fits = {lens: _fit(kept, target, lens) for lens in candidates}
    scores = [_cross_validate(fits[lens], kept, target) for lens in candidates]
    chosen = _choose(scores)
    bundle = fits[candidates[chosen]]
    rig = replace(_rig(bundle, size, medium), rms_px=rms(bundle, _observations(kept, target)))
    return rig, _report(bundle, rig, kept, target, dropped + outliers, scores, chosen)


def _usable_views(views: Sequence[View]) -> tuple[list[View], list[ViewReport]]:
    usable: list[View] = []
    dropped: list[ViewReport] = []
    sizes = [view.image_size for view in views]
    common = max(set(sizes), key=sizes.count) if sizes else (0, 0)
    for view in views:
        missing = [side for side, corners in zip(SIDES, (view.left, view.right), strict=True) if corners is None]
        if view.image_size != common:
            dropped.append(ViewReport(view.name, reason=f"image of {view.image_size}, the others are {common}"))
        elif missing:
            dropped.append(ViewReport(view.name, reason=f"target not found in the {' and the '.join(missing)} image"))
        elif _common_ids(view).size < MIN_CORNERS:
            dropped.append(ViewReport(view.name, reason=f"only {_common_ids(view).size} corners in common, {MIN_CORNERS} needed"))
        else:
            usable.append(view)
    if len(usable) < MIN_VIEWS:
        first = f": {dropped[0].name}: {dropped[0].reason}" if dropped else ""
        raise CalibrationError(
            f"the target was found in both images of {len(usable)} of {len(views)} pairs, at least {MIN_VIEWS} are needed "
            f"(15 make a good calibration); check the target's numbers{first}"
        )
    return usable, dropped


def _common_ids(view: View) -> NDArray[np.int64]:
    assert view.left is not None and view.right is not None
    return np.intersect1d(view.left.ids, view.right.ids)


def _observations(views: Sequence[View], target: Target) -> list[Observation]:
    observations = []
    for number, view in enumerate(views):
        for side, corners in enumerate((view.left, view.right)):
            assert corners is not None
            observations.append(Observation(number, side, target.points_m[corners.ids], corners.pixels))
    return observations


def _fit(views: Sequence[View], target: Target, lens: tuple[CameraModel, int]) -> Bundle:
    """Each camera alone, the rig between them by the median over views, then everything together."""
    observations = _observations(views, target)
    sides = [[replace(o, side=0) for o in observations if o.side == side] for side in (0, 1)]
    left, right = (fit_camera(*lens, own, views[0].image_size) for own in sides)
    steps = [T_right @ inverse_transform(T_left) for T_left, T_right in zip(left.T_left_target, right.T_left_target, strict=True)]
    start = Bundle(lens[0], (left.intrinsics[0], right.intrinsics[0]), _middle(steps), left.T_left_target)
    return solve(start, observations)


def _middle(transforms: list[Array]) -> Array:
    """The transform nearest to all others: no mean of rotations needed, and one bad view changes nothing."""
    stacked = np.array([T[:3].ravel() for T in transforms])
    distances = np.linalg.norm(stacked[:, None] - stacked[None], axis=2).sum(axis=1)
    return transforms[int(np.argmin(distances))]


def _without_outliers(views: list[View], target: Target) -> tuple[list[View], list[ViewReport]]:
    """Drop the worst view and fit again, until none stands out, so that a bad one cannot make a good one look bad."""
    kept, dropped = list(views), []
    while len(kept) > max(MIN_VIEWS, len(views) // 2):
        observations = _observations(kept, target)
        bundle = min((_fit(kept, target, lens) for lens in LENSES[:2]), key=lambda fit: rms(fit, observations))
        errors = _view_errors(bundle, kept, target)
        both = np.sqrt((errors**2).mean(axis=1))
        worst = int(np.argmax(both))
        limit = max(OUTLIER_RATIO * float(np.median(both)), OUTLIER_MIN_PX)
        if both[worst] <= limit:
            break
        dropped.append(
            ViewReport(
                kept[worst].name, float(errors[worst, 0]), float(errors[worst, 1]), _blame(bundle, kept, worst, target, limit)
            )
        )
        del kept[worst]
    return kept, dropped


def _view_errors(bundle: Bundle, views: Sequence[View], target: Target) -> Array:
    """(views, 2) rms in the left and the right image, pixels."""
    errors = np.zeros((len(views), 2))
    for observation in _observations(views, target):
        errors[observation.view, observation.side] = rms(bundle, [observation])
    return errors


def _blame(bundle: Bundle, views: list[View], number: int, target: Target, limit: float) -> str:
    """Why a view does not fit: each image alone tells whether its corners are bad, or the two disagree."""
    own = [o for o in _observations(views, target) if o.view == number]
    alone = [rms(solve(bundle, [o], poses_only=True), [o]) for o in own]
    bad = [f"{side} ({error:.2f} px)" for side, error in zip(SIDES, alone, strict=True) if error > limit]
    if bad:
        return f"corners do not lie on a flat board in {' and '.join(bad)}: blurred, misread or bent"
    return f"left and right disagree ({rms(bundle, own):.2f} px): taken at different moments?"


def _cross_validate(full: Bundle, views: list[View], target: Target) -> LensScore:
    """Fit without every tenth view in turn, from ``full`` on, and predict the views left out, but for the target's pose."""
    folds = min(FOLDS, len(views))
    squares = np.zeros(len(views))
    rows, fits = [], []
    for fold in range(folds):
        left_out = np.arange(len(views)) % folds == fold
        train = [view for view, out in zip(views, left_out, strict=True) if not out]
        test = [view for view, out in zip(views, left_out, strict=True) if out]
        fitted = solve(replace(full, T_left_target=full.T_left_target[~left_out]), _observations(train, target))
        start = replace(fitted, T_left_target=full.T_left_target[left_out])
        posed = solve(start, _observations(test, target), poses_only=True)
        squares[left_out] = (_view_errors(posed, test, target) ** 2).mean(axis=1)
        rows.append(_row_errors(_rig(fitted, views[0].image_size, "water"), test))
        fits.append([*(intrinsics[:2].mean() for intrinsics in fitted.intrinsics), np.linalg.norm(fitted.T_right_left[:3, 3])])
    focal_left, focal_right, baseline_m = _jackknife(np.array(fits))
    lens = (full.model, full.intrinsics[0].size - 4)
    return LensScore(*lens, squares, np.concatenate(rows), (focal_left, focal_right), baseline_m)


def _jackknife(estimates: Array) -> tuple[float, ...]:
    """Standard deviations from (groups, k) estimates without one group each (Efron 1982, The Jackknife, ch. 3).

    Unlike those of least squares they hold where the corners of a view err together: a target bent, a shutter late.
    """
    groups = len(estimates)
    return tuple(np.sqrt((groups - 1) * estimates.var(axis=0)).tolist())


def _rig(bundle: Bundle, size: Size, medium: Medium) -> StereoRig:
    left, right = (to_camera(bundle.model, intrinsics, size) for intrinsics in bundle.intrinsics)
    return StereoRig(left, right, bundle.T_right_left, medium)


def _row_errors(rig: StereoRig, views: list[View]) -> Array:
    """(n,) left minus right row of the corners in common after rectification, pixels."""
    pixels = []
    for corners in ([view.left for view in views], [view.right for view in views]):
        side = [(own, _common_ids(view)) for own, view in zip(corners, views, strict=True)]
        pixels.append(np.concatenate([own.pixels[np.searchsorted(own.ids, ids)] for own, ids in side if own is not None]))
    left, right = rectified_points(rig, *pixels)
    return left[:, 1] - right[:, 1]


def _choose(scores: list[LensScore]) -> int:
    """The simplest lens whose left-out error is no worse than the best's beyond doubt, or by too little to matter.

    As the rule of one standard error (Hastie et al. 2009, sec. 7.10), with two: from ten views, chance favours a needless
    coefficient often enough, and it costs more than it gives.
    """
    best = min(scores, key=lambda score: score.rms_px)
    for number, score in enumerate(scores):
        difference = score.squares - best.squares
        standard_error = difference.std(ddof=1) / np.sqrt(difference.size)
        if difference.mean() <= max(2 * standard_error, NEGLIGIBLE * best.squares.mean()):
            return number
    return scores.index(best)


def _report(
    bundle: Bundle,
    rig: StereoRig,
    views: list[View],
    target: Target,
    dropped: list[ViewReport],
    scores: list[LensScore],
    chosen: int,
) -> CalibrationReport:
    errors = _view_errors(bundle, views, target).tolist()
    sides = [[o for o in _observations(views, target) if o.side == side] for side in (0, 1)]
    return CalibrationReport(
        rig=rig,
        scores=tuple(scores),
        chosen=chosen,
        views=tuple(ViewReport(view.name, *error) for view, error in zip(views, errors, strict=True)) + tuple(dropped),
        rms_left_px=rms(bundle, sides[0]),
        rms_right_px=rms(bundle, sides[1]),
        corners_left=np.concatenate([o.pixels for o in sides[0]]),
        corners_right=np.concatenate([o.pixels for o in sides[1]]),
    )
