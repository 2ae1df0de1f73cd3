"""Measures of color quality: on neutral targets, against known truth, over range, across frames.

Images are float arrays (..., 3), RGB, as a fraction of full scale, in the encoding that they are
viewed in (sRGB for PNG), unless said. A pixel that is NaN in any channel is unknown and left out. A
measure over no pixels is NaN.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.errors import library_for
from stereo_seecolor.files.srgb import decode_srgb

Pixels = NDArray[np.floating]
"""(..., 3) RGB as a fraction of full scale, NaN = unknown."""

CLIPPED = 254 / 255
"""Fraction of full scale from which a channel counts as clipped."""

# IEC 61966-2-1
_XYZ_FROM_LINEAR = np.array(
    [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
)
_WHITE = _XYZ_FROM_LINEAR.sum(axis=1)


@dataclass(frozen=True)
class NeutralScore:
    """A neutral target: psi_deg in degrees; clipped_fraction of its pixels, 0 to 1."""

    psi_deg: float
    clipped_fraction: float
    pixels: int


@dataclass(frozen=True)
class TruthScore:
    """An image against its truth: angles in degrees, CIEDE2000 after one exposure gain,
    range_consistency 1 = no trend.
    """

    angle_deg: float
    angle_after_gains_deg: float
    ciede2000: float
    range_consistency: float
    clipped_fraction: float
    pixels: int


def gray_angle_deg(pixels: Pixels) -> NDArray[np.float64]:
    """Angle of each color to gray (the paper's psi), degrees, (...); NaN where black."""
    return angle_deg(pixels, np.ones(3))


def angle_deg(pixels: Pixels, truth: Pixels) -> NDArray[np.float64]:
    """Angle between two colors, degrees, shape (...); NaN where either is black or unknown."""
    (r, g, b), (x, y, z) = (
        np.moveaxis(np.asarray(colors, dtype=np.float64), -1, 0) for colors in (pixels, truth)
    )
    # arctan2 keeps what arccos rounds away
    cross = np.sqrt((g * z - b * y) ** 2 + (b * x - r * z) ** 2 + (r * y - g * x) ** 2)
    known = (r * r + g * g + b * b > 0) & (x * x + y * y + z * z > 0)
    return np.where(known, np.degrees(np.arctan2(cross, r * x + g * y + b * z)), np.nan)


def clipped(pixels: Pixels) -> NDArray[np.bool_]:
    """True where any channel is at full scale, shape (...)."""
    return np.asarray((np.asarray(pixels) >= CLIPPED).any(axis=-1))


def score_neutral(pixels: Pixels) -> NeutralScore:
    """Score of a neutral target's pixels (N, 3): mean psi, and the fraction clipped."""
    known = np.isfinite(pixels).all(axis=-1)
    angles = gray_angle_deg(pixels[known])
    if not np.isfinite(angles).any():
        return NeutralScore(float("nan"), float("nan"), 0)
    return NeutralScore(
        float(np.nanmean(angles)), float(clipped(pixels[known]).mean()), int(known.sum())
    )


def score_truth(
    image: Pixels, truth: Pixels, range_m: NDArray[np.floating] | None = None, darkest: float = 0.06
) -> TruthScore:
    """Score of an image (..., 3) against its truth (..., 3), both sRGB.

    range_m (...): meters, for the range consistency. darkest: pixels whose brightest true channel
    is below this fraction of full scale are left out, as their color is noise; so are those that
    the truth has clipped.
    """
    lit = np.isfinite(image).all(axis=-1) & (truth.max(axis=-1) >= darkest) & ~clipped(truth)
    nan = float("nan")
    if not lit.any():
        return TruthScore(nan, nan, nan, nan, nan, 0)
    known, true = np.asarray(image[lit], dtype=np.float64), np.asarray(truth[lit], dtype=np.float64)
    light, true_light = decode_srgb(known), decode_srgb(true)
    exposed = light * exposure_gain(light, true_light)
    consistency = range_consistency(known, true, range_m[lit]) if range_m is not None else nan
    return TruthScore(
        angle_deg=float(np.nanmean(angle_deg(known, true))),
        angle_after_gains_deg=float(
            np.nanmean(angle_deg(known * channel_gains(known, true), true))
        ),
        ciede2000=float(np.median(color_differences(exposed, true_light))),
        range_consistency=consistency,
        clipped_fraction=float(clipped(known).mean()),
        pixels=int(lit.sum()),
    )


def channel_gains(pixels: Pixels, truth: Pixels) -> NDArray[np.float64]:
    """(3,) gain of each channel that brings an image nearest to its truth: the median ratio, robust
    to noise of dark pixels.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = np.where(pixels > 0, truth / pixels, np.nan).reshape(-1, 3)
    return (
        np.nan_to_num(np.nanmedian(ratios, axis=0), nan=1.0)
        if np.isfinite(ratios).any(axis=0).all()
        else np.ones(3)
    )


def exposure_gain(pixels: Pixels, truth: Pixels) -> float:
    """The gain, common to all channels, that gives an image (linear light) the median brightness of
    its truth.
    """
    brightness, true = pixels.sum(axis=-1), truth.sum(axis=-1)
    bright = brightness > 0
    return float(np.median(true[bright] / brightness[bright])) if bright.any() else 1.0


def range_consistency(pixels: Pixels, truth: Pixels | None, range_m: NDArray[np.floating]) -> float:
    """Bias of red/blue in the farthest third against the nearest third: 1 = no trend, below 1 = the
    distance is too blue.

    truth None: the image's own ratios, which hold the scene's trend as well.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = (
            pixels[..., 0]
            / pixels[..., 2]
            / (1.0 if truth is None else truth[..., 0] / truth[..., 2])
        )
    good = np.isfinite(ratio) & (ratio > 0) & np.isfinite(range_m)
    if good.sum() < 3:
        return float("nan")
    near, far = np.quantile(range_m[good], [1 / 3, 2 / 3])
    return float(
        np.median(ratio[good & (range_m >= far)]) / np.median(ratio[good & (range_m <= near)])
    )


def lab_from_linear(linear: Pixels) -> NDArray[np.float64]:
    """CIE L*a*b* under D65 of linear sRGB primaries, shape (..., 3)."""
    t = (
        _XYZ_FROM_LINEAR
        / _WHITE[:, None]
        @ np.maximum(np.moveaxis(np.asarray(linear, dtype=np.float64), -1, 0), 0).reshape(3, -1)
    )
    x, y, z = np.where(t > (6 / 29) ** 3, np.cbrt(t), t / (3 * (6 / 29) ** 2) + 4 / 29).reshape(
        3, *np.shape(linear)[:-1]
    )
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=-1)


def color_differences(light: Pixels, truth: Pixels) -> NDArray[np.float64]:
    """CIEDE2000 between linear colors (..., 3), shape (...)."""
    return ciede2000(lab_from_linear(light), lab_from_linear(truth))


def ciede2000(lab: Pixels, other: Pixels) -> NDArray[np.float64]:
    """CIEDE2000 color difference of L*a*b* colors (..., 3), shape (...). Raises DeviceError without
    scikit-image.
    """
    with library_for("CIEDE2000", "evaluation"):
        # half a second that other commands need not wait for
        from skimage.color import deltaE_ciede2000

    return np.asarray(deltaE_ciede2000(lab, other), np.float64)  # type: ignore[no-untyped-call]
