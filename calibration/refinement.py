"""The result of refining a rig: what has moved since its calibration, with standard errors."""

from dataclasses import dataclass

import numpy as np

from calibration.errors import counted

UNSEEN = (
    "not visible in vertical disparity: the length of the baseline, a focal length wrong in both "
    "cameras, and images shifted along the baseline (a principal point): measure an object "
    "of known length"
)
YAW_WARNING = (
    "yaw shifts every disparity by {:+.2f} +- {:.2f} px, and changes ranges: it is the least "
    "certain of these numbers"
)


@dataclass(frozen=True)
class Movement:
    """How much a parameter has changed, with its standard error. name: see refine.PARAMETERS;
    radians, or a relative change for scale.
    """

    name: str
    value: float
    std: float


@dataclass(frozen=True)
class Refinement:
    """The refinement of a rig with matches of a dive.

    movements: all parameters, with standard errors; none where the calibration was left as it is.
    before_px, after_px: median absolute vertical disparity before, and after on pairs left out of
    the fit. pairs, matches: what it rests on.
    focal_px: focal length of the rectified images.
    """

    movements: tuple[Movement, ...]
    before_px: float
    after_px: float
    pairs: int
    matches: int
    focal_px: float

    def std(self, name: str) -> float:
        """The standard error of a parameter; 0 where it was not estimated."""
        return next((each.std for each in self.movements if each.name == name), 0.0)

    @property
    def slope_std(self) -> tuple[float, float]:
        """Standard errors of the disparity's slopes along and across the baseline, pixels a pixel:
        another focal length stretches the right image, and a roll turns it.
        """
        return self.std("scale"), self.std("roll")

    @property
    def summary(self) -> str:
        """One line: the data that it rests on, and the gain."""
        return (
            f"{self.matches} points in {counted(self.pairs, 'pair')}: vertical disparity "
            f"{self.before_px:.2f} px as calibrated, "
            f"{self.after_px:.2f} px refined, on pairs left out of the fit (median)"
        )

    def lines(self) -> list[str]:
        """The report, line by line."""
        text_lines = [self.summary]
        if not self.movements:
            return [
                *text_lines,
                "these pairs agree better with the calibration, which is used unchanged",
                UNSEEN,
            ]
        for movement in self.movements:
            text_lines.append(f"  {self._described(movement)}")
            if movement.name == "yaw":
                shift_px = movement.value * self.focal_px, movement.std * self.focal_px
                text_lines.append(f"  {YAW_WARNING.format(*shift_px)}")
        return [*text_lines, UNSEEN]

    def _described(self, movement: Movement) -> str:
        if movement.name == "scale":
            return f"right focal length: {movement.value:+.4%} +- {movement.std:.4%}"
        value_deg, std_deg = np.degrees([movement.value, movement.std])
        text = f"{movement.name}: {value_deg:+.4f} +- {std_deg:.4f} degrees"
        if movement.name == "pitch":
            text += (
                f" (a vertical offset of {movement.value * self.focal_px:+.2f} +- "
                f"{movement.std * self.focal_px:.2f} px)"
            )
        return text
