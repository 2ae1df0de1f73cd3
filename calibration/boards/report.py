"""The report on a calibration: errors by view, coverage, standard errors, and a verdict."""

from dataclasses import dataclass, field
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.boards.bundle import Lens
from calibration.boards.changes import Change
from calibration.boards.target_shape import TargetShape
from calibration.geometry import Array
from calibration.rig import StereoRig
from calibration.suspicions import placement_suspicions

Verdict = Literal["good", "usable", "do it again"]
GRID = (8, 6)  # cells of the image in which corners are counted
MIN_CORNERS_IN_CELL = 3  # a cell with fewer is not covered

# The limits of each figure, up to which a calibration is good, and up to which it is usable.
# root mean square; the matcher searches along rows and loses matches beyond half a pixel
MAX_ROW_ERROR_PX = (0.25, 0.5)
MAX_RMS_PX = (0.35, 1.0)  # of reprojection
MAX_FOCAL_STD = (0.005, 0.02)  # fraction of the focal length, and so of every range
MAX_BASELINE_STD = (0.005, 0.02)  # the same of the baseline
MAX_RANGE_STD = (0.005, 0.02)  # the same of ranges, which nine tenths of the image stay below
MIN_COVERAGE = (0.6, 0.35)  # fraction of the cells of both images
MIN_VIEWS = (10, 5)  # pairs


@dataclass(frozen=True)
class ViewReport:
    """The report on one pair: rms in each image, pixels, NaN where it was not measured; reason: why
    it was dropped, None if it was used.
    """

    name: str
    left_px: float = np.nan
    right_px: float = np.nan
    reason: str | None = None


@dataclass(frozen=True, eq=False)
class LensScore:
    """The score of a lens model: how well it predicts views left out of its fit.

    squares: (views,) mean squared reprojection error, px^2; row_errors: (n,) left minus right row
    after rectification, px, NaN where the lens model does not reach a corner. figures: (3 + n,)
    focal length left and right (the mean of fx and fy), pixels, baseline, meters, and reciprocal
    ranges at n places of the image, 1 / m; std: (3 + n,) their standard errors; spread: (3 + n,)
    the part of them that is the choice of the lens model, zero where it is not known.
    """

    lens: Lens
    squares: Array
    row_errors: Array
    figures: Array
    std: Array
    spread: Array = field(default_factory=lambda: np.zeros(3))

    @property
    def relative_std(self) -> Array:
        """(3 + n,) standard errors as fractions; 1 where a fit gives no range, and at most."""
        return np.minimum(np.abs(np.nan_to_num(self.std / self.figures, nan=1.0)), 1.0)

    @property
    def range_std(self) -> float:
        """The standard error of ranges, relative, that nine tenths of the image stay below."""
        places = np.sort(self.relative_std[3:])
        return float(places[int(0.9 * len(places))]) if len(places) else 1.0

    @property
    def rms_px(self) -> float:
        """The rms error over all left-out views, pixels."""
        return float(np.sqrt(self.squares.mean()))

    @property
    def row_error_px(self) -> float:
        """Mean absolute difference of rows after rectification; infinite where the lens model did
        not reach a corner.
        """
        return float(np.nan_to_num(np.abs(self.row_errors), nan=np.inf).mean())


@dataclass(frozen=True, eq=False)
class CalibrationReport:
    """The figures of a calibration.

    scores: of each lens model tried; lens: of the one taken, the same object as in scores. views:
    those used, then those dropped.
    rms_left_px, rms_right_px: reprojection errors of the common fit, by image; both together are in
    the rig.
    corners_left, corners_right: (n, 2) pixels of all corners used. shape: of the target, None of
    too few views or where the rig changed; change: from a photograph on, None where there is none.
    """

    rig: StereoRig
    scores: tuple[LensScore, ...]
    lens: LensScore
    views: tuple[ViewReport, ...]
    rms_left_px: float
    rms_right_px: float
    corners_left: Array
    corners_right: Array
    shape: TargetShape | None = None
    change: Change | None = None

    @property
    def used(self) -> tuple[ViewReport, ...]:
        """The views of the fit."""
        return tuple(view for view in self.views if view.reason is None)

    @property
    def focal_std(self) -> float:
        """Standard error of the focal length, relative, of the worse camera."""
        cameras = (self.rig.left, self.rig.right)
        return max(
            float(std / camera.K[0, 0])
            for std, camera in zip(self.lens.std[:2], cameras, strict=True)
        )

    @property
    def coverage(self) -> tuple[float, float]:
        """Share of the left and of the right image, in cells of a grid, in which corners lay."""
        left, right = (self._counts(corners) for corners in (self.corners_left, self.corners_right))
        return float((left >= MIN_CORNERS_IN_CELL).mean()), float(
            (right >= MIN_CORNERS_IN_CELL).mean()
        )

    @property
    def empty_regions(self) -> tuple[str, ...]:
        """Ninths of either image in which no corners lay, such as "left image, top right"."""
        empty = []
        for side, corners in (("left", self.corners_left), ("right", self.corners_right)):
            few = self._counts(corners, (3, 3)) < MIN_CORNERS_IN_CELL
            for row, column in np.argwhere(few).tolist():
                words = f"{('top', 'middle', 'bottom')[row]} {('left', 'middle', 'right')[column]}"
                empty.append(f"{side} image, {words}")
        return tuple(empty)

    @property
    def verdict(self) -> tuple[Verdict, str]:
        """good, usable or do it again; and why, in one line."""
        lens, focal_std = self.lens, self.focal_std
        baseline_std = float(lens.std[2]) / self.rig.baseline_m
        bad_target = self.shape.text if self.shape else None
        rms_px, rows_px = self.rig.rms_px or np.nan, lens.row_error_px
        figures = [
            (rows_px, MAX_ROW_ERROR_PX, f"vertical disparity {rows_px:.2f} px after rectification"),
            (rms_px, MAX_RMS_PX, f"rms {rms_px:.2f} px"),
            (
                focal_std,
                MAX_FOCAL_STD,
                f"standard error of the focal length {focal_std:.2%}: "
                + (bad_target or "take more views, and tilt the target more"),
            ),
            (
                baseline_std,
                MAX_BASELINE_STD,
                f"standard error of the baseline {baseline_std:.2%}: "
                + (bad_target or "take more views, nearer, with both cameras still"),
            ),
            (
                lens.range_std,
                MAX_RANGE_STD,
                f"standard error of ranges {lens.range_std:.2%} or more in a tenth of the image: "
                + (bad_target or "cover both images to their corners"),
            ),
            (
                -min(self.coverage),
                (-MIN_COVERAGE[0], -MIN_COVERAGE[1]),
                f"corners in only {min(self.coverage):.0%} of the image",
            ),
            (-len(self.used), (-MIN_VIEWS[0], -MIN_VIEWS[1]), f"{len(self.used)} views alone"),
        ]
        again = [text for value, (_, usable), text in figures if not value <= usable]
        if self.change:
            again = [self.change.text, *again]
        if again:
            return "do it again", "; ".join(again)
        usable = [text for value, (good, _), text in figures if not value <= good]
        if usable:
            return "usable", "; ".join(usable)
        return "good", f"{figures[0][2]}, {figures[1][2]}, {len(self.used)} views"

    @property
    def is_wrong(self) -> bool:
        """True if ranges of this rig may be wrong by more than a usable one's: do it again."""
        return self.verdict[0] == "do it again"

    def lines(self) -> list[str]:
        """The report line by line, the verdict last."""
        rig, lens = self.rig, self.lens
        views = [
            f"  {view.name}: left {view.left_px:.2f} px, right {view.right_px:.2f} px"
            if view.reason is None
            else f"  {view.name}: dropped, {view.reason}"
            for view in sorted(self.views, key=lambda view: view.name)
        ]
        tried = [
            f"  {score.lens.name}: {score.rms_px:.3f} px, rows {score.row_error_px:.3f} px"
            + (" (taken)" if score is lens else "")
            for score in self.scores
        ]
        suspicious = placement_suspicions(rig)
        if self.shape and self.shape.text:
            suspicious.append(f"{self.shape.text}: measure it, and glue it flat")
        if self.change:
            suspicious.append(
                f"{self.change.text}: calibrate with the photographs before and after apart"
            )
        verdict, why = self.verdict
        coverage = (
            f"corners in {self.coverage[0]:.0%} of the left and {self.coverage[1]:.0%} of "
            "the right image"
        )
        return [
            f"{len(self.used)} of {len(self.views)} views used:",
            *views,
            "error on views left out of the fit:",
            *tried,
            f"rms: left {self.rms_left_px:.3f} px, right {self.rms_right_px:.3f} px, stereo "
            f"{rig.rms_px:.3f} px",
            f"focal length: left {rig.left.K[0, 0]:.1f} +- {lens.std[0]:.1f} px, "
            f"right {rig.right.K[0, 0]:.1f} +- {lens.std[1]:.1f} px",
            f"baseline: {rig.baseline_m * 1000:.2f} +- {lens.std[2] * 1000:.2f} mm "
            f"({lens.spread[2] * 1000:.2f} mm between lens models that predict as well)",
            f"ranges at the target's distance: +- {np.median(lens.relative_std[3:]):.2%}, "
            f"+- {lens.range_std:.2%} or more in a tenth of the image",
            f"rows after rectification, on views left out: {lens.row_error_px:.3f} px",
            coverage
            + (f"; none in: {'; '.join(self.empty_regions)}" if self.empty_regions else ""),
            *(f"suspicious: {text}" for text in suspicious),
            f"{verdict}: {why}",
        ]

    def coverage_picture(self) -> NDArray[np.uint8]:
        """Draw where corners lay, left beside right: (H, W, 3) RGB; empty cells are red."""
        width, height = self.rig.left.image_size
        scale = 640 / width
        sides = []
        for corners in (self.corners_left, self.corners_right):
            empty = (self._counts(corners) < MIN_CORNERS_IN_CELL).astype(np.uint8)
            shade = cv2.resize(empty, (640, round(height * scale)), interpolation=cv2.INTER_NEAREST)
            side = np.full((*shade.shape, 3), 255, np.uint8)
            side[shade == 1] = (255, 200, 190)
            for x, y in corners * scale:
                cv2.circle(side, (round(x), round(y)), 2, (20, 90, 160), -1, cv2.LINE_AA)
            sides.append(
                cv2.copyMakeBorder(side, 4, 4, 4, 4, cv2.BORDER_CONSTANT, value=(90, 90, 90))
            )
        return np.hstack(sides)

    def _counts(self, corners: Array, cells: tuple[int, int] = GRID) -> Array:
        width, height = self.rig.left.image_size
        counts, _, _ = np.histogram2d(
            corners[:, 1], corners[:, 0], bins=cells[::-1], range=[[0, height], [0, width]]
        )
        return np.asarray(counts)
