"""The uncertainty of the white point of the water, and a change of the white point."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.files.srgb import LUMINANCE
from stereo_seecolor.records import PerChannel, Water

DOUBTED = 0.08
"""Standard error of red or blue over green above which gray may be off by more than a degree."""
DISPLAY_POWER = 2.2
"""Power of linear light over displayed values, about that of sRGB."""
DOUBT = "white point: "
"""Beginning of the warning."""


def white_errors(water: Water) -> NDArray[np.float64]:
    """Compute (2,) relative standard errors of red and of blue over green of the white point; NaN
    if unknown.

    Errors of water parameters are those of the logarithms less their mean. These three sum to 0, so
    that their variances determine their covariances: Var(r - g) = 2 Var(r) + 2 Var(g) - Var(b).
    """
    red, green, blue = (water.standard_errors.get("white", np.full(3, np.nan)) / water.white) ** 2
    variances = np.array([2 * red + 2 * green - blue, 2 * blue + 2 * green - red])
    return np.asarray(np.sqrt(np.maximum(variances, 0.0)))


def gray_error_deg(water: Water) -> float:
    """Compute the standard error of displayed gray, degrees from (1, 1, 1); NaN if unknown."""
    logs = water.standard_errors.get("white", np.full(3, np.nan)) / water.white
    return float(np.degrees(np.linalg.norm(logs) / np.sqrt(3) / DISPLAY_POWER))


def white_doubt(water: Water) -> str:
    """Return a warning about an uncertain white point, with what to do; "" if it is certain."""
    red, blue = errors = white_errors(water)
    if not (errors > DOUBTED).any():
        return ""
    return (
        f"{DOUBT}all colors may share a tint of about {gray_error_deg(water):.1f} degrees, because "
        f"no white reference is known (standard error of red over green {red:.0%}, of blue over "
        f"green {blue:.0%}). Fix: a color chart or white card in a frame (water OUT --chart), or a "
        "spot that is white, or sand (water OUT --white FRAME:x,y, or --sand)"
    )


def with_white(water: Water, white: PerChannel, error: PerChannel) -> Water:
    """Change the color of the white point of a water, not its level, nor other parameters. white:
    (3,) of any level. error: (3,) standard errors of its logarithms less their mean.
    """
    level = np.exp((np.log(water.white) - np.log(white)).mean())
    brighter = float(LUMINANCE @ (water.white / (level * white)))
    return replace(
        water,
        white=level * white,
        standard_errors={**water.standard_errors, "white": level * white * error},
        exposure=water.exposure and water.exposure / brighter,
    )
