"""Removal of outlying views: pairs that show two moments, misread boards, blur."""

from collections.abc import Sequence

import numpy as np

from calibration.boards.bundle import Array, Bundle, Lens, rms, solve
from calibration.boards.lens import first_guess
from calibration.boards.report import ViewReport
from calibration.boards.target_views import MIN_VIEWS, SIDES, TargetView, observations_of
from calibration.boards.targets import Target

OUTLIER_RATIO = 3.0  # times the median view's error: three sigma of good views
# corners are found to 0.1 to 0.2 px; below this a view is no worse than its neighbors
OUTLIER_MIN_PX = 0.3
# of the image's width, from a rig guessed by single views to 1 %: a board that has moved meanwhile
WRONG_PAIR = 0.03
DISAGREE = "left and right disagree"  # how the reason of a pair of another rig or moment begins
WRONG_PAIR_RATIO = 5.0  # times the median, where the guess itself is poor


def without_outliers(
    views: list[TargetView], target: Target, lenses: Sequence[Lens]
) -> tuple[list[TargetView], list[ViewReport], list[Bundle]]:
    """The views that fit one rig, why others do not, and the fits of these lenses to the first.

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
    reason = (
        f"{DISAGREE} ({{:.0f}} px): not exposed at the same moment, paired wrongly, or a "
        "camera moved?"
    )
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
    """Why a view does not fit: one image is bad (alone, too), or the two images disagree."""
    own = [o for o in observations_of(views, target) if o.view == number]
    alone = [rms(solve(bundle, [o], poses_only=True), [o]) for o in own]
    bad = [
        f"{side} ({error:.2f} px)"
        for side, error in zip(SIDES, alone, strict=True)
        if error > limit
    ]
    if bad:
        return (
            f"the corners do not fit a flat board in {' and '.join(bad)}: blurred, misread or bent"
        )
    return (
        f"{DISAGREE} ({rms(bundle, own):.2f} px): exposed at different moments, or a camera moved?"
    )
