"""A calibration held against images of a dive: what is wrong, with its evidence in numbers."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError
from calibration.geometry import RectifiedPair
from calibration.matches import Matches, find_matches
from calibration.plan import plan_rectification, raw_points, rectified_points
from calibration.rectification import Rectification
from calibration.rig import StereoRig
from calibration.suspicions import suspicions

Array = NDArray[np.float64]
__all__ = ["RowCheck", "judge_matches", "settle_reading", "suspicions", "vertical_disparity"]
ACCEPTABLE_ROW_ERROR_PX = 0.25
MIN_MATCHES = 50
INDICES = np.arange(1.0, 1.4401, 0.02)
WATER_INDEX = (1.26, 1.42)


@dataclass(frozen=True, eq=False)
class RowCheck:
    """How well rows agree on images of a dive.

    pairs, matches: what it rests on. row_error_px: median difference of rows, absolute. offset_px, scale, roll_deg: the vertical
    offset, vertical scale (1 = none) and rotation of the right image that explain the most of it; unexplained_px: the median that
    these leave. behind_share: share of matches with impossible disparity (points behind infinity).
    index: the refractive index of a flat port that explains the matches best, 1 = none; index_unexplained_px: what it leaves.
    """

    pairs: int
    matches: int
    row_error_px: float
    offset_px: float
    scale: float
    roll_deg: float
    unexplained_px: float
    behind_share: float
    index: float
    index_unexplained_px: float

    @property
    def acceptable(self) -> bool:
        """True if rows agree to a quarter of a pixel and left is left."""
        return self.row_error_px <= ACCEPTABLE_ROW_ERROR_PX and not self.swapped

    @property
    def swapped(self) -> bool:
        """True if nearly all points lie behind infinity."""
        return self.behind_share > 0.8

    @property
    def air_in_water(self) -> bool:
        """True if bending the rays as a flat port in water does explains rows that do not agree without it."""
        better = self.index_unexplained_px < 0.7 * self.unexplained_px and self.unexplained_px - self.index_unexplained_px > 0.05
        return better and WATER_INDEX[0] <= self.index <= WATER_INDEX[1]

    @property
    def advice(self) -> tuple[str, ...]:
        """What to do, one line each, the gravest first."""
        advice = []
        if self.swapped:
            advice.append(f"{self.behind_share:.0%} of the points lie behind infinity: the left and right folders are swapped")
        if self.air_in_water:
            advice.append(
                f"light bent by a flat port (index {self.index:.2f}) explains the rows, {self.index_unexplained_px:.2f} px left "
                f"instead of {self.unexplained_px:.2f} px: it looks like a calibration made in air; calibrate in water, "
                "or describe the port in cam.yaml"
            )
        if self.row_error_px > ACCEPTABLE_ROW_ERROR_PX and not self.air_in_water:
            advice.append(self._explanation())
        return tuple(advice)

    def lines(self) -> list[str]:
        """All of it for a person to read, the verdict last."""
        verdict = "acceptable" if self.acceptable else "NOT acceptable"
        return [
            f"{self.matches} points in {self.pairs} pairs: rows differ by {self.row_error_px:.2f} px (median); offset "
            f"{self.offset_px:+.2f} px, vertical scale {self.scale - 1:+.3%}, roll {self.roll_deg:+.3f} degrees leave "
            f"{self.unexplained_px:.2f} px",
            *self.advice,
            f"the calibration is {verdict} for these images (limit {ACCEPTABLE_ROW_ERROR_PX} px)",
        ]

    def _explanation(self) -> str:
        cause = f"offset {self.offset_px:+.2f} px, vertical scale {self.scale - 1:+.3%}, roll {self.roll_deg:+.3f} degrees"
        if self.unexplained_px > 0.7 * self.row_error_px:
            return (
                f"rows differ by {self.row_error_px:.2f} px, and no {cause} explains it ({self.unexplained_px:.2f} px left): "
                "another lens or another rig than the calibrated one, moving things or a shutter out of step; calibrate again"
            )
        return f"rows differ by {self.row_error_px:.2f} px, as after {cause}: a camera has moved since; calibrate again"


def settle_reading(rig: StereoRig, pairs: Iterable[tuple[NDArray[np.generic], NDArray[np.generic]]]) -> StereoRig:
    """The one of a rig's alternatives whose rows agree best on raw image pairs, and as a doubt how it was chosen.

    The rig itself where it has no alternatives. Raises CalibrationError if no reading finds enough points in both images.
    """
    if not rig.alternatives:
        return rig
    rectification = Rectification.from_rig(rig)
    found = [find_matches(rectification, left, right) for left, right in pairs]
    raw = [raw_points(rig, matches.left, matches.right) for matches in found]
    readings, errors_px = (rig, *rig.alternatives), []
    failure = CalibrationError("no reading of the calibration fits the images")
    for reading in readings:
        try:
            seen = [Matches(*rectified_points(reading, left, right)) for left, right in raw]
            errors_px.append(judge_matches(reading, seen).row_error_px)
        except CalibrationError as error:
            errors_px.append(np.inf)
            failure = error
    best = int(np.argmin(errors_px))
    if not np.isfinite(errors_px[best]):
        raise failure
    others = ", ".join(f"{error:.1f}" for i, error in enumerate(errors_px) if i != best)
    doubt = f"{readings[best].reading}: images decide: rows differ by {errors_px[best]:.2f} px, and by {others} px otherwise"
    return replace(readings[best], alternatives=(), doubts=(*readings[best].doubts, doubt))


def vertical_disparity(rig: StereoRig, pairs: Iterable[tuple[NDArray[np.generic], NDArray[np.generic]]]) -> RowCheck:
    """Measure on raw image pairs, (H, W) or (H, W, C), whether the calibration fits them.

    Raises CalibrationError if the images are of another size, or too few points are found in both.
    """
    rectification = Rectification.from_rig(rig)
    return judge_matches(rig, [find_matches(rectification, left, right) for left, right in pairs])


def judge_matches(rig: StereoRig, found: list[Matches]) -> RowCheck:
    """As vertical_disparity, from matches in the rectified images of each pair."""
    plan = plan_rectification(rig)
    pair, R_left, R_right = plan.matching_pair, plan.R_left_matching, plan.R_right_matching
    left, right = (np.concatenate([np.zeros((0, 2)), *(getattr(m, side) for m in found)]) for side in ("left", "right"))
    if len(left) >= MIN_MATCHES:
        kept = _inliers(left, right, pair)
        left, right = left[kept], right[kept]
    if len(left) < MIN_MATCHES:
        raise CalibrationError(
            f"only {len(left)} points were found in both images of {len(found)} pairs, {MIN_MATCHES} are needed: "
            "give pairs with texture, and see whether both images show the same scene at the same time"
        )
    left, right = left - [pair.cx_left_px, pair.cy_px], right - [pair.cx_right_px, pair.cy_px]
    rows = right[:, 1] - left[:, 1]
    model, unexplained = _explain(rows, left)
    index, index_unexplained = _best_index([(R_left, left), (R_right, right)], pair.focal_px)
    return RowCheck(
        pairs=len(found),
        matches=len(rows),
        row_error_px=float(np.median(np.abs(rows))),
        offset_px=float(model[0]),
        scale=float(1 + model[1]),
        roll_deg=float(np.degrees(model[2])),
        unexplained_px=float(np.median(np.abs(unexplained))),
        behind_share=float((left[:, 0] - right[:, 0] < -0.5).mean()),
        index=index,
        index_unexplained_px=index_unexplained,
    )


def _inliers(left: Array, right: Array, pair: RectifiedPair) -> NDArray[np.bool_]:
    """Matches whose rows differ as their neighbors' do: within a few deviations of a smooth trend over the image."""
    x, y = ((left - np.array(pair.image_size) / 2) / pair.focal_px).T
    disparity = (left[:, 0] - right[:, 0]) / pair.focal_px
    one = np.ones_like(x)
    terms = np.column_stack([one, x, y, x * y, y**2, x**2 * y, y**3, x * y * disparity])
    _, rest = _robust_fit(terms, right[:, 1] - left[:, 1])
    return np.abs(rest) < max(4 * 1.4826 * float(np.median(np.abs(rest))), 0.3)


def _explain(rows: Array, offsets: Array) -> tuple[Array, Array]:
    """Offset, scale and roll (radians) that explain rows best, and what they leave. offsets: (n, 2) from the middle, pixels."""
    return _robust_fit(np.column_stack([np.ones(len(rows)), offsets[:, 1], offsets[:, 0]]), rows)


def _robust_fit(terms: Array, values: Array) -> tuple[Array, Array]:
    """Least absolute deviations by iterated reweighting; coefficients and residuals."""
    weights = np.ones(len(values))
    for _ in range(15):
        root = np.sqrt(weights)[:, None]
        coefficients, *_ = np.linalg.lstsq(terms * root, values * root[:, 0], rcond=None)
        rest = values - terms @ coefficients
        weights = 1 / np.maximum(np.abs(rest), 0.05)
    return np.asarray(coefficients), rest


def _best_index(sides: list[tuple[Array, Array]], focal_px: float) -> tuple[float, float]:
    """The refractive index behind flat ports, square to each optical axis, whose bending makes rows agree best; and what it leaves.

    A calibration made in air takes a pixel for its ray in air; in the water, sin(theta) is 1/n of that (Snell). Where the two
    images see a point at different distances from their middles, the wrong rays move it to different rows: that is the evidence.
    Each index is judged after the offset, scale and roll that suit it best, in pixels of the same size in the scene.

    sides: rectifying rotation (3, 3), and pixels (n, 2) from the principal point, of the left and the right image.
    """
    rays = [np.column_stack([pixels / focal_px, np.ones(len(pixels))]) @ R for R, pixels in sides]
    rays = [directions / np.linalg.norm(directions, axis=1, keepdims=True) for directions in rays]
    left_over = []
    for index in INDICES:
        pixels = []
        for (R, _), directions in zip(sides, rays, strict=True):
            across = directions[:, :2] / index
            bent = np.column_stack([across, np.sqrt(1 - (across**2).sum(axis=1))]) @ R.T
            pixels.append(bent[:, :2] / bent[:, 2:] * focal_px * index)
        _, rest = _explain(pixels[1][:, 1] - pixels[0][:, 1], pixels[0])
        left_over.append(float(np.median(np.abs(rest))))
    best = int(np.argmin(left_over))
    return float(INDICES[best]), left_over[best]
