"""Changes of the rig or of the target between two photographs: a zoom, a camera that was moved.

All views are fitted by one rig, and by one that differs from a photograph on in one way alone. The
rows of a dive (calibration.verification.changes) show half a pixel; corners of a target show a
tenth, and focal lengths that change on both sides.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import cv2
import numpy as np

from calibration.boards.bundle import (
    Array,
    Bundle,
    CornerObservation,
    equations_by_view,
    moved,
    rms,
    solve,
)
from calibration.boards.target_shape import TargetShape
from calibration.resampling import TINY, jackknife
from calibration.transforms import inverse

LEAST_VIEWS = 3  # on either side of a change
ROUNDS = 4  # of Gauss-Newton
# of scaled parameters: the coefficients of a lens are nearly dependent, and steps diverge along
# what the views do not determine
UNDETERMINED = 1e-9
# of squared errors of views left out: without a change .78 at least (synthetic boards, also bent
# and of another lens model, sorted by distance or place), with 2 % more focal length .70 at most
CLEARLY = 0.75
SURE = 3.0  # standard errors, over the views, of the logarithm of that ratio
AS_GOOD = 1.1  # of the least squared error: causes that are named beside each other


@dataclass(frozen=True, eq=False)
class Change:
    """fits: of the rig before and after; text: from which photograph on, and what differs."""

    fits: tuple[Bundle, Bundle]
    text: str


@dataclass(frozen=True, eq=False)
class _Cause:
    """What may differ. directions: (g, k) of what views share, for k numbers; figures: of the fits
    before and after; text: formatted with each of them and its standard error.
    """

    text: str
    directions: Array
    figures: Callable[[Bundle, Bundle], Array]


def _focal_percent(side: int) -> Callable[[Bundle, Bundle], Array]:
    return lambda before, after: (
        100 * (after.intrinsics[side][:1] / before.intrinsics[side][:1] - 1)
    )


def _baseline_percent(before: Bundle, after: Bundle) -> Array:
    was, now = (np.linalg.norm(fit.T_right_left[:3, 3]) for fit in (before, after))
    return np.array([100 * (now / was - 1)])


def _movement(before: Bundle, after: Bundle) -> Array:
    """Degrees and millimeters."""
    step = inverse(before.T_right_left) @ after.T_right_left
    centers_m = [inverse(fit.T_right_left)[:3, 3] for fit in (before, after)]
    turn = np.linalg.norm(cv2.Rodrigues(step[:3, :3])[0])
    return np.array([np.degrees(turn), 1000 * np.linalg.norm(centers_m[1] - centers_m[0])])


@dataclass(frozen=True, eq=False)
class _Stepped:
    """A fit in which what views share differs from the photograph ``first`` on. parts: the fits to
    the views before and after; size: (k,) in these directions; squares: (views,) of errors.
    """

    parts: tuple[Bundle, Bundle]
    equations: tuple[Array, Array]
    squares: Array
    directions: Array
    first: int
    size: Array

    @classmethod
    def fit(
        cls, start: Bundle, halves: list[list[CornerObservation]], directions: Array, first: int
    ) -> "_Stepped":
        """Of least squares, by Gauss-Newton from a common fit on."""
        shared, size = start, np.zeros(directions.shape[1])
        poses = [start.T_left_target[:first], start.T_left_target[first:]]
        for left in reversed(range(ROUNDS + 1)):
            still = np.zeros((len(start.T_left_target), 6))
            rigs = [shared, moved(shared, directions @ size, still)]
            parts = [
                solve(replace(rig, T_left_target=own), half, poses_only=True)
                for rig, own, half in zip(rigs, poses, halves, strict=True)
            ]
            poses = [part.T_left_target for part in parts]
            found = cls._of(parts, halves, directions, first, size)
            if left:
                step = _step(found.equations, directions, first)
                split = len(step) - len(size)
                shared, size = moved(shared, step[:split], still), size + step[split:]
        return found

    @classmethod
    def free(cls, start: Bundle, halves: list[list[CornerObservation]], first: int) -> "_Stepped":
        """A fit to each half alone, where all may differ."""
        poses = start.T_left_target[:first], start.T_left_target[first:]
        parts = [
            solve(replace(start, T_left_target=own), half)
            for own, half in zip(poses, halves, strict=True)
        ]
        shared = sum(intrinsics.size for intrinsics in start.intrinsics) + 6
        return cls._of(parts, halves, np.eye(shared), first, np.zeros(shared))

    @classmethod
    def _of(
        cls,
        parts: list[Bundle],
        halves: list[list[CornerObservation]],
        directions: Array,
        first: int,
        size: Array,
    ) -> "_Stepped":
        found = [equations_by_view(part, half) for part, half in zip(parts, halves, strict=True)]
        J2, Jr = (np.concatenate(both) for both in zip(*found, strict=True))
        return cls((parts[0], parts[1]), (J2, Jr), _squares(parts, halves), directions, first, size)

    @property
    def error(self) -> float:
        """The sum of squared errors."""
        return float(self.squares.sum())

    def left_out(self) -> tuple[Array, Array]:
        """Squared errors (views,) of each view by the others, and the size (views, k) by them."""
        squares, steps = _left_out(self.equations, self.squares, self.directions, self.first)
        return squares, self.size + steps

    def described(self, cause: _Cause) -> str:
        """The cause with its numbers."""
        before, after = self.parts
        still = np.zeros((len(before.T_left_target), 6))
        others = [
            cause.figures(before, moved(before, self.directions @ size, still))
            for size in self.left_out()[1]
        ]
        numbers = np.column_stack([cause.figures(before, after), jackknife(np.array(others))])
        return cause.text.format(*numbers.ravel())


def _causes(bundle: Bundle) -> list[_Cause]:
    first = (0, bundle.intrinsics[0].size)
    rig = sum(intrinsics.size for intrinsics in bundle.intrinsics)
    shared = np.eye(rig + 6)
    kinds = 1 if bundle.lens.square_pixels else 2  # fx stands for both
    left, right = (
        shared[:, at : at + kinds] @ intrinsics[:kinds, None]
        for at, intrinsics in zip(first, bundle.intrinsics, strict=True)
    )
    baseline = shared[:, -3:] @ bundle.T_right_left[:3, 3:]
    differs = "differs by {:+.2f} +- {:.2f} %"
    return [
        _Cause(
            f"the focal length of both cameras {differs} (zoom, focus)",
            left + right,
            _focal_percent(0),
        ),
        _Cause(
            f"the focal length of the left camera {differs} (zoom, focus)", left, _focal_percent(0)
        ),
        _Cause(
            f"the focal length of the right camera {differs} (zoom, focus)",
            right,
            _focal_percent(1),
        ),
        _Cause(
            f"the baseline {differs} (a camera moved along it, or another target)",
            baseline,
            _baseline_percent,
        ),
        _Cause(
            "the cameras stand otherwise, one turned by {:.2f} +- {:.2f} degrees and moved by "
            "{:.1f} +- {:.1f} mm",
            shared[:, -6:],
            _movement,
        ),
    ]


def change_midway(
    bundle: Bundle,
    observations: Sequence[CornerObservation],
    names: Sequence[str],
    shape: TargetShape | None = None,
) -> Change | None:
    """The change after which views are predicted clearly better, also by a target of this shape,
    where there is one.

    bundle: the common fit to these observations. names: of its views.
    """
    views = len(names)
    equations = equations_by_view(bundle, observations)
    causes = _causes(bundle)
    tried = [
        (_gain(equations, cause.directions, first), first)
        for first in range(LEAST_VIEWS, views - LEAST_VIEWS + 1)
        for cause in causes
    ]
    if not tried:
        return None
    first = max(tried)[1]
    halves = [
        [
            replace(one, view=one.view - start)
            for one in observations
            if start <= one.view < start + count
        ]
        for start, count in ((0, first), (first, views - first))
    ]
    free = _Stepped.free(bundle, halves, first)
    fits = []
    for cause in causes:
        with suppress(np.linalg.LinAlgError):  # one that leads to no rig is not the cause
            fits.append((cause, _Stepped.fit(bundle, halves, cause.directions, first)))
    least = min([fit.error for _, fit in fits] + [free.error / CLEARLY])
    likely = [(cause, fit) for cause, fit in fits if fit.error <= AS_GOOD * least]
    best = min((fit for _, fit in likely), key=lambda fit: fit.error, default=free)
    same = _squares([bundle], [observations])
    common, _ = _left_out(equations, same, np.zeros((len(equations[1][0]), 0)), first)
    apart, _ = best.left_out()
    better = np.log(common / apart)
    if (
        apart.sum() > CLEARLY * common.sum()
        or better.mean() < SURE * better.std(ddof=1) / np.sqrt(views)
        or (shape and change_midway(shape.fit, shape.observations, names) is None)
    ):
        return None
    simplest = min((len(fit.size) for _, fit in likely), default=0)
    texts = [fit.described(cause) for cause, fit in likely if len(fit.size) == simplest]
    what = ", or ".join(texts) or "the views fit another rig"
    return Change(best.parts, f"from {names[first]} on {what}")


def _squares(fits: Sequence[Bundle], observations: Sequence[Sequence[CornerObservation]]) -> Array:
    """The sum of squared errors of each view of some fits, infinite of a fit that is none."""
    squares = []
    for fit, seen in zip(fits, observations, strict=True):
        for view in range(len(fit.T_left_target)):
            own = [one for one in seen if one.view == view]
            squares.append(rms(fit, own) ** 2 * sum(len(one.pixels) for one in own))
    return np.nan_to_num(squares, nan=np.inf)


def _stepped(equations: tuple[Array, Array], directions: Array, first: int) -> tuple[Array, Array]:
    """J^T J and -J^T r of what all views share, and of what differs from ``first`` on."""
    J2, Jr = equations
    after = J2[first:].sum(axis=0) @ directions
    top = np.hstack([J2.sum(axis=0), after])
    bottom = np.hstack([after.T, directions.T @ after])
    right = np.concatenate([Jr.sum(axis=0), directions.T @ Jr[first:].sum(axis=0)])
    return np.vstack([top, bottom]), -right


def _step(equations: tuple[Array, Array], directions: Array, first: int) -> Array:
    """The step (g + k,) of least squares; parameters of one size, and those without effect stay."""
    matrix, right = _stepped(equations, directions, first)
    scale = 1 / np.sqrt(np.maximum(np.diag(matrix), TINY))
    scaled = matrix * scale[:, None] * scale
    return np.asarray(scale * np.linalg.lstsq(scaled, scale * right, rcond=UNDETERMINED)[0])


def _gain(equations: tuple[Array, Array], directions: Array, first: int) -> float:
    """What the step takes off the squared errors."""
    return float(_step(equations, directions, first) @ _stepped(equations, directions, first)[1])


def _left_out(
    equations: tuple[Array, Array], squares: Array, directions: Array, first: int
) -> tuple[Array, Array]:
    """Squared errors (views,) of each view by the fit to the others, and that fit's step in these
    directions (views, k).
    """
    J2, Jr = equations
    errors, steps = [], []
    for view in range(len(J2)):
        others = np.arange(len(J2)) != view
        before = first - (view < first)
        step = _step((J2[others], Jr[others]), directions, before)
        shared, size = np.split(step, [len(Jr[view])])
        at = shared + (directions @ size if view >= first else 0.0)
        errors.append(squares[view] + 2 * Jr[view] @ at + at @ J2[view] @ at)
        steps.append(size)
    return np.maximum(errors, TINY), np.array(steps)
