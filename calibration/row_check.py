"""How well a calibration fits images of a dive, and what explains it where it does not."""

from dataclasses import dataclass

ACCEPTABLE_ROW_ERROR_PX = 0.25  # matching searches one row: the confidence of fine texture falls from here on
WARNING_ROW_ERROR_PX = 0.5  # half a pixel off, a row matches its neighbor as well as itself
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
    def warning(self) -> str | None:
        """What a run over a dive must say before it starts; None where rows agree to half a pixel and left is left."""
        if self.row_error_px <= WARNING_ROW_ERROR_PX and not self.swapped:
            return None
        return "; ".join(self.advice)

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
