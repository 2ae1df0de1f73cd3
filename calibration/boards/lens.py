"""A rig from views of a target, without the views that lie outside the rest."""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from calibration.boards.bundle import (
    Array,
    Bundle,
    CornerObservation,
    Lens,
    camera_matrix,
    rms,
    solve,
)
from calibration.boards.report import ViewReport
from calibration.boards.targets import MIN_VIEWS, SIDES, Target, TargetView, observations_of
from calibration.errors import CalibrationError
from calibration.geometry import inverse_transform, rigid
from calibration.rig import Camera, CameraModel

# A rig from views of a target: each camera alone, the rig between them, then everything together.

FISHEYE_TRIAL_ITERATIONS = 10  # of each guess; the best one is then fitted to the end
FISHEYE_FOCAL_GUESSES = (0.25, 0.4, 0.6, 0.9, 1.4)  # of the image's width
Size = tuple[int, int]


def fit_rig(views: Sequence[TargetView], target: Target, lens: Lens) -> Bundle:
    """The rig and the target's poses of least reprojection error."""
    return solve(first_guess(views, target, lens), observations_of(views, target))


def first_guess(views: Sequence[TargetView], target: Target, lens: Lens) -> Bundle:
    """Each camera fitted alone, and the rig between them that most views agree on.

    Raises CalibrationError if the views do not determine a camera.
    """
    observations = observations_of(views, target)
    sides = [[replace(o, side=0) for o in observations if o.side == side] for side in (0, 1)]
    left, right = (fit_camera(lens, own, views[0].image_size) for own in sides)
    steps = [
        T_right @ inverse_transform(T_left)
        for T_left, T_right in zip(left.T_left_target, right.T_left_target, strict=True)
    ]
    return Bundle(
        lens, (left.intrinsics[0], right.intrinsics[0]), _middle(steps), left.T_left_target
    )


def fit_camera(lens: Lens, observations: list[CornerObservation], image_size: Size) -> Bundle:
    """Fit one camera alone by bundle adjustment. observations: all of side 0, views numbered from 0
    without a gap.
    """
    if lens.model == "fisheye":
        fits = [
            _fit_fisheye(lens, guess * image_size[0], observations, image_size)
            for guess in FISHEYE_FOCAL_GUESSES
        ]
        return solve(min(fits, key=lambda fit: rms(fit, observations)), observations)
    points = [observation.points_m.astype(np.float32) for observation in observations]
    pixels = [observation.pixels.astype(np.float32) for observation in observations]
    try:
        _, K, distortion, rotations, translations = cv2.calibrateCamera(
            points, pixels, image_size, None, None
        )
    except cv2.error as error:
        raise CalibrationError(
            "the views do not determine a camera: tilt the target differently in each"
        ) from error
    focal_px = np.full(2, (K[0, 0] + K[1, 1]) / 2) if lens.square_pixels else K[[0, 1], [0, 1]]
    intrinsics = np.concatenate(
        [focal_px, K[:2, 2], np.ravel(distortion)[:5], np.zeros(lens.coefficients - 5)]
    )
    poses = np.array(
        [rigid(cv2.Rodrigues(r)[0], t) for r, t in zip(rotations, translations, strict=True)]
    )
    return solve(Bundle(lens, (intrinsics, intrinsics), np.eye(4), poses), observations)


def target_pose(camera: Camera, observation: CornerObservation) -> Array:
    """Estimate the pose of the target in the camera, (4, 4) target to camera, from one view's
    corners.
    """
    rays = camera.rays(observation.pixels)
    seen = np.isfinite(rays[:, 0])
    if seen.sum() < 4:
        return rigid(np.eye(3), np.array([0, 0, 5 * np.ptp(observation.points_m)]))
    _, rotation, translation = cv2.solvePnP(
        observation.points_m[seen], rays[seen, :2], np.eye(3), None
    )
    return rigid(cv2.Rodrigues(rotation)[0], translation)


def to_camera(model: CameraModel, intrinsics: Array, image_size: Size) -> Camera:
    """A Camera of bundle intrinsics."""
    return Camera(camera_matrix(intrinsics), intrinsics[4:].copy(), image_size, model)


def _fit_fisheye(
    lens: Lens, focal_px: float, observations: list[CornerObservation], image_size: Size
) -> Bundle:
    """From an ideal fisheye (r = f theta) of this focal length; cv2.fisheye.calibrate has no such
    start and often fails.
    """
    width, height = image_size
    intrinsics = np.array([focal_px, focal_px, (width - 1) / 2, (height - 1) / 2, 0, 0, 0, 0])
    camera = to_camera("fisheye", intrinsics, image_size)
    poses = np.array([target_pose(camera, observation) for observation in observations])
    return solve(
        Bundle(lens, (intrinsics, intrinsics), np.eye(4), poses),
        observations,
        iterations=FISHEYE_TRIAL_ITERATIONS,
    )


def _middle(transforms: list[Array]) -> Array:
    """The transform nearest to all others: no mean of rotations needed, and one bad view changes
    nothing.
    """
    stacked = np.array([T[:3].ravel() for T in transforms])
    distances = np.linalg.norm(stacked[:, None] - stacked[None], axis=2).sum(axis=1)
    return transforms[int(np.argmin(distances))]


# Removal of outlying views: pairs that show two moments, misread boards, blur.

OUTLIER_RATIO = 3.0  # times the median view's error: three sigma of good views
# corners are found to 0.1 to 0.2 px; below this a view is no worse than its neighbors
OUTLIER_MIN_PX = 0.3
# of the image's width, from a rig guessed by single views to 1 %: a board that has moved meanwhile
WRONG_PAIR = 0.03
WRONG_PAIR_RATIO = 5.0  # times the median, where the guess itself is poor


def without_outliers(
    views: list[TargetView], target: Target, lenses: Sequence[Lens]
) -> tuple[list[TargetView], list[ViewReport], list[Bundle]]:
    """The views that fit one rig, the others with the reason, and the fits of these lenses to the
    first.

    First the pairs that most others contradict, by each camera alone; then the worst of a common
    fit, again and again until none stands out, so that a bad view cannot make a good one look bad.
    lenses: whichever of these fits best is the judge.
    """
    kept, dropped, guesses = _without_wrong_pairs(views, target, lenses)
    while True:
        observations = observations_of(kept, target)
        fits = [solve(guess, observations) for guess in guesses]
        bundle = min(fits, key=lambda fit: rms(fit, observations))
        errors = view_errors(bundle, kept, target)
        both = np.sqrt((errors**2).mean(axis=1))
        worst = int(np.argmax(both))
        limit = max(OUTLIER_RATIO * float(np.median(both)), OUTLIER_MIN_PX)
        if len(kept) <= max(MIN_VIEWS, len(views) // 2) or both[worst] <= limit:
            return kept, dropped, fits
        left_px, right_px = errors[worst].tolist()
        dropped.append(
            ViewReport(
                kept[worst].name, left_px, right_px, _blame(bundle, kept, worst, target, limit)
            )
        )
        del kept[worst]
        guesses = [first_guess(kept, target, lens) for lens in lenses]


def _without_wrong_pairs(
    views: list[TargetView], target: Target, lenses: Sequence[Lens]
) -> tuple[list[TargetView], list[ViewReport], list[Bundle]]:
    """Drop pairs whose right corners lie far from where the left ones and the rig of most views put
    them. Returns the others, the reasons, and first guesses by the others.
    """
    guesses = [first_guess(views, target, lens) for lens in lenses]
    guessed = (view_errors(guess, views, target) for guess in guesses)
    # the left camera was fitted alone
    errors = min(guessed, key=lambda guess: float(guess[:, 0].mean()))[:, 1]
    wrong = errors > max(
        WRONG_PAIR * views[0].image_size[0], WRONG_PAIR_RATIO * float(np.median(errors))
    )
    if not wrong.any() or wrong.sum() > len(views) - MIN_VIEWS:
        return list(views), [], guesses
    reason = "left and right disagree ({:.0f} px): not taken at the same moment, or paired wrongly?"
    dropped = [
        ViewReport(view.name, reason=reason.format(error))
        for view, error, bad in zip(views, errors, wrong, strict=True)
        if bad
    ]
    kept = [view for view, bad in zip(views, wrong, strict=True) if not bad]
    return kept, dropped, [first_guess(kept, target, lens) for lens in lenses]


def view_errors(bundle: Bundle, views: Sequence[TargetView], target: Target) -> Array:
    """Compute the rms of each view in the left and the right image: (views, 2) pixels."""
    errors = np.zeros((len(views), 2))
    for observation in observations_of(views, target):
        errors[observation.view, observation.side] = rms(bundle, [observation])
    return errors


def _blame(
    bundle: Bundle, views: list[TargetView], number: int, target: Target, limit: float
) -> str:
    """Why a view does not fit: the corners of one image are bad (it does not fit alone), or the two
    images disagree.
    """
    own = [o for o in observations_of(views, target) if o.view == number]
    alone = [rms(solve(bundle, [o], poses_only=True), [o]) for o in own]
    bad = [
        f"{side} ({error:.2f} px)"
        for side, error in zip(SIDES, alone, strict=True)
        if error > limit
    ]
    if bad:
        return (
            f"corners do not lie on a flat board in {' and '.join(bad)}: blurred, misread or bent"
        )
    return f"left and right disagree ({rms(bundle, own):.2f} px): taken at different moments?"
