"""Measures of color quality: on neutral targets, against known truth, over range, across frames.

Images are float arrays (..., 3), RGB, as a fraction of full scale, in the encoding that they are
viewed in (sRGB for PNG), unless said. A pixel that is NaN in any channel is unknown and left out. A
measure over no pixels is NaN.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from stereo_seecolor.compute.threads import cores
from stereo_seecolor.errors import DeviceError
from stereo_seecolor.files.srgb import decode_srgb
from stereo_seecolor.geometry import rigid_alignment, transformed

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
    """A neutral target: psi_deg in degrees; clipped_fraction of its pixels in [0, 1]; pixels
    counted.
    """

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
    """Angle of each color to gray (the paper's psi), degrees, shape (...); NaN where black or
    unknown.
    """
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
    """Score of a neutral target's pixels (N, 3): mean psi, and the fraction clipped, without which
    psi is not a score.
    """
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
        ciede2000=float(
            np.median(ciede2000(lab_from_linear(exposed), lab_from_linear(true_light)))
        ),
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


def ciede2000(lab: Pixels, other: Pixels) -> NDArray[np.float64]:
    """CIEDE2000 color difference of L*a*b* colors (..., 3), shape (...). Raises DeviceError without
    scikit-image.
    """
    try:
        # half a second that other commands need not wait for
        from skimage.color import (
            deltaE_ciede2000,
        )
    except ImportError as error:
        raise DeviceError(
            f"color differences need scikit-image ({error}): pip install "
            "'stereo-seecolor[evaluation]'"
        ) from error

    return np.asarray(deltaE_ciede2000(lab, other), np.float64)  # type: ignore[no-untyped-call]


# Errors of a map against the truth: of its track, and of its cloud against the true surface.


@dataclass(frozen=True)
class TrajectoryError:
    """Error of a track. rms_m: absolute trajectory error after a rigid alignment (no scale).
    path_m: length of the true track.
    """

    rms_m: float
    path_m: float

    @property
    def fraction(self) -> float:
        """The error as a fraction of the path."""
        return self.rms_m / self.path_m


def trajectory_error(
    estimate_m: NDArray[np.float64], truth_m: NDArray[np.float64]
) -> TrajectoryError:
    """Absolute trajectory error of positions (N, 3) in the order they were taken (Sturm et al.
    2012).
    """
    off_m = transformed(rigid_alignment(estimate_m, truth_m), estimate_m) - truth_m
    path_m = float(np.linalg.norm(np.diff(truth_m, axis=0), axis=1).sum())
    return TrajectoryError(float(np.sqrt((off_m**2).sum(axis=1).mean())), path_m)


def nearest_distance_m(
    queries_m: NDArray[np.floating], points_m: NDArray[np.floating], reach_m: float
) -> NDArray[np.float64]:
    """Distance of each query (N, 3) to the nearest of the points (M, 3), meters; infinite beyond
    ``reach_m``.
    """
    tree = cKDTree(points_m, balanced_tree=False, compact_nodes=False)
    bound = np.nextafter(reach_m, np.inf)  # scipy leaves out what lies exactly at its bound
    return np.asarray(
        tree.query(queries_m, distance_upper_bound=bound, workers=cores())[0], np.float64
    )


def surface_points(
    height_m: NDArray[np.floating], origin_m: tuple[float, float], cell_m: float
) -> NDArray[np.float64]:
    """Points of a height field (ny, nx), grid point (row, column) at origin + (column, row) * cell;
    steep walls are filled in.

    Between neighbors that differ by more than a cell in height, points are put every cell along the
    edge.
    """
    rows, columns = np.mgrid[: height_m.shape[0], : height_m.shape[1]]
    grid = np.stack(
        [origin_m[0] + columns * cell_m, origin_m[1] + rows * cell_m, height_m], axis=-1
    ).astype(np.float64)
    pieces = [grid.reshape(-1, 3)]
    for start, end in ((grid[:-1], grid[1:]), (grid[:, :-1], grid[:, 1:])):
        steps = np.ceil(np.abs(end[..., 2] - start[..., 2]) / cell_m)
        steep = steps > 1
        for k in range(1, int(steps.max(initial=0))):
            has = steep & (steps > k)
            fraction = (k / steps[has])[:, None]
            pieces.append(start[has] * (1 - fraction) + end[has] * fraction)
    return np.concatenate(pieces)
