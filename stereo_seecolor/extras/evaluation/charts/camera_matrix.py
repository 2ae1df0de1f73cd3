"""The camera's color matrix from charts: with water and white point removed, it takes patches to
their published colors.

    published color of a patch = M (I - B(z)) / (A(z) white brightness of the chart), rows of M sum
        to 1

Every patch is first averaged over all charts, since the difference of its paint from the published
color is the same in all of them. Each row of M is then a ridge regression with two unknowns towards
the identity.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stereo_seecolor.extras.evaluation.charts.chart_types import ChartType
from stereo_seecolor.extras.evaluation.measures import color_differences
from stereo_seecolor.files.srgb import decode_srgb
from stereo_seecolor.records import Array


@dataclass(frozen=True)
class MatrixSettings:
    """Weights of patches, and limits below which a fit is rejected."""

    print_error: float = 0.03
    """Standard error of a patch's color, fraction of its brightest channel: print, fading, tilt."""
    least_error: float = 0.01
    """Least standard error of a patch's color, fraction of white: gloss, light from neighbors."""
    backscatter_error: float = 0.1
    """Fraction by which the fitted backscatter is off (docs/lab/color.md: 10 to 25 % in haze)."""
    entry: float = 1.0
    """Standard deviation of an entry off the diagonal before a chart is seen. Those of raw cameras'
    matrices are within 0.8 in daylight; where little red arrives, red takes the more of the other
    channels.
    """
    most_noise: float = 3.0
    """Norm of a row, by which it multiplies noise: a larger one is moved towards the identity."""
    covered: float = 2.0
    """Misfit at which a patch weighs half, in median misfits: part of a chart may be covered."""
    reweightings: int = 12
    """Steps of new weights: enough for them to converge."""
    least_patches: int = 12
    """Least patches of different colors, grays included: half a ColorChecker."""
    least_colored: int = 6
    """Least patches that are not gray."""
    least_gain: float = 1.0
    """CIEDE2000, a difference that is just seen, that a matrix must take away from patches left out
    of its fit: what little is left of the backscatter looks like a camera, too (0.7 on the sample
    dive, whose camera is sRGB's).
    """
    orders: int = 200
    """Random orders of its patches that a chart must fit better than."""


SETTINGS = MatrixSettings()


@dataclass(frozen=True, eq=False)
class SeenPatches:
    """A chart with the water and the survey's white point removed. color (N, 3): linear light, 1 =
    white, NaN for patches that are not used. error (N,): standard error of a channel. haze (3,):
    backscatter that was subtracted, mean over patches.
    clipped: number of patches that are not used since the camera clipped them.
    """

    type: ChartType
    color: Array
    error: Array
    haze: Array
    clipped: int

    @property
    def published(self) -> Array:
        """(N, 3) published colors, linear light."""
        return decode_srgb(self.type.srgb)

    def ciede2000(self, matrix: Array) -> float:
        """Median CIEDE2000 of the patches, multiplied by a matrix, to their published colors."""
        known = np.isfinite(self.error)
        return (
            float(np.median(color_differences(self.color[known] @ matrix.T, self.published[known])))
            if known.any()
            else float("nan")
        )

    @property
    def is_in_order(self) -> bool:
        """Whether the patches differ less from their published colors than in any of many random
        orders, as those of a chart do, in any water, and those of another thing, or of a chart
        turned around, do not. Too few patches tell nothing.
        """
        known = np.isfinite(self.error)
        if known.sum() < SETTINGS.least_patches:
            return True
        color, published = self.color[known], self.published[known]
        rng = np.random.default_rng(0)
        least = min(
            float(np.median(color_differences(color, rng.permutation(published))))
            for _ in range(SETTINGS.orders)
        )
        return self.ciede2000(np.eye(3)) < least


@dataclass(frozen=True, eq=False)
class CameraMatrix:
    """A color matrix. matrix, errors: (3, 3), with standard errors. patches: number of colors that
    it was fitted to. noise (3,): factor by which it multiplies each channel's noise.

    before, after, left_out: median CIEDE2000 of the patches without it, with it, and with one
    fitted to all other patches.
    """

    matrix: Array
    errors: Array
    patches: int
    noise: Array
    before: float
    after: float
    left_out: float


def camera_matrix(charts: Sequence[SeenPatches]) -> CameraMatrix | str:
    """The matrix fitted to all charts together, or a line on why they give none."""
    color, published, error, colored = _patch_means(charts)
    clipped = sum(chart.clipped for chart in charts)
    if len(color) < SETTINGS.least_patches or colored < SETTINGS.least_colored:
        return (
            f"{len(color)} colors of charts can be used, {colored} of them not gray; "
            f"{SETTINGS.least_patches} and "
            f"{SETTINGS.least_colored} are needed ({clipped} patches are clipped)"
        )
    error = _with_covered(color, published, error)
    matrix, errors = _fit(color, published, error)
    before = float(np.median(color_differences(color, published)))
    after = float(np.median(color_differences(color @ matrix.T, published)))
    left_out = float(np.median(color_differences(_left_out(color, published, error), published)))
    if left_out > before - SETTINGS.least_gain:
        return (
            f"it improves patches left out of its fit too little: CIEDE2000 {left_out:.1f}, "
            f"{before:.1f} without"
        )
    haze = SETTINGS.backscatter_error * np.mean([chart.haze for chart in charts], axis=0)
    moved = [_fit(hazier, published, error)[0] - matrix for hazier in _with_haze(color, haze)]
    errors = np.sqrt(errors**2 + np.square(moved).sum(axis=0))
    return CameraMatrix(
        matrix, errors, len(color), np.linalg.norm(matrix, axis=1), before, after, left_out
    )


def _left_out(color: Array, published: Array, error: Array) -> Array:
    """(P, 3) the color of each patch multiplied by a matrix fitted to all others."""
    corrected = np.empty_like(color)
    for patch in range(len(color)):
        others = np.delete(np.arange(len(color)), patch)
        matrix, _ = _fit(color[others], published[others], error[others])
        corrected[patch] = matrix @ color[patch]
    return corrected


def _patch_means(charts: Sequence[SeenPatches]) -> tuple[Array, Array, Array, int]:
    """Mean color, published color (P, 3) and error (P,) of each patch; how many are not gray."""
    found, colored = [], 0
    for name in dict.fromkeys(chart.type.name for chart in charts):
        of = [chart for chart in charts if chart.type.name == name]
        color, error = (
            np.stack([chart.color for chart in of]),
            np.stack([chart.error for chart in of]),
        )
        weight = np.where(np.isfinite(error), error**-2, 0.0)
        for patch in np.flatnonzero(weight.any(axis=0)):
            w = weight[:, patch]
            mean = np.average(np.nan_to_num(color[:, patch]), axis=0, weights=w)
            own = float(np.sqrt(1 / w.sum()))
            brightest = float(of[0].published[patch].max())
            # more charts do not tell what a patch's paint is
            least = max(SETTINGS.print_error * brightest, SETTINGS.least_error)
            found.append((mean, of[0].published[patch], max(own, least)))
            colored += patch not in range(len(error[0]))[of[0].type.grays]
    if not found:
        return np.empty((0, 3)), np.empty((0, 3)), np.empty(0), 0
    colors, published, errors = zip(*found, strict=True)
    return np.stack(colors), np.stack(published), np.array(errors), colored


def _with_covered(color: Array, published: Array, error: Array) -> Array:
    """(P,) the errors, increased for patches that do not fit the matrix (Cauchy): they may be
    covered, shaded, or stained.
    """
    weighed = error
    for _ in range(SETTINGS.reweightings):
        left = (
            np.linalg.norm(color @ _fit(color, published, weighed)[0].T - published, axis=1) / error
        )
        usual = max(float(np.median(left)), 1.0)
        weighed = error * np.sqrt(1 + (left / (SETTINGS.covered * usual)) ** 2)
    return weighed


def _fit(color: Array, published: Array, error: Array) -> tuple[Array, Array]:
    """The matrix and its standard errors."""
    rows = [_row(i, color, published, error) for i in range(3)]
    return np.stack([row for row, _ in rows]), np.stack([errors for _, errors in rows])


def _with_haze(color: Array, haze: Array) -> list[Array]:
    """The colors with an offset ``haze`` (3,), one channel at a time, white kept white."""
    return [(color + left) / (1 + left) for left in np.diag(haze)]


def _row(i: int, color: Array, published: Array, error: Array) -> tuple[Array, Array]:
    """Row i and its errors, of published_i - color_i = sum of m_ij (color_j - color_i)."""
    others = [j for j in range(3) if j != i]
    X, y = color[:, others] - color[:, [i]], published[:, i] - color[:, i]
    entries, covariance = _ridge(X, y, error**2)
    left = float(((y - X @ entries) ** 2 / error**2).sum()) / max(len(y) - 2, 1)
    if left > 1:  # paint and camera disagree by more than was expected
        entries, covariance = _ridge(X, y, left * error**2)
    change, errors = np.empty(3), np.empty(3)
    change[others], change[i] = entries, -entries.sum()
    errors[others], errors[i] = np.sqrt(np.diag(covariance)), np.sqrt(covariance.sum())
    part = _allowed(i, change)
    return np.eye(3)[i] + part * change, part * errors


def _allowed(i: int, change: Array) -> float:
    """The largest fraction of a change to row i, at most 1, that keeps noise in its limit."""
    own, squared = float(change[i]), float((change**2).sum())
    if 1 + 2 * own + squared <= SETTINGS.most_noise**2:
        return 1.0
    return float((np.sqrt(own**2 + squared * (SETTINGS.most_noise**2 - 1)) - own) / squared)


def _ridge(X: Array, y: Array, variance: Array) -> tuple[Array, Array]:
    """Ridge regression of y, with these variances, on columns X: coefficients, covariance."""
    covariance: Array = np.linalg.inv(
        X.T @ (X / variance[:, None]) + np.eye(X.shape[1]) / SETTINGS.entry**2
    ).astype(np.float64)
    return covariance @ (X.T @ (y / variance)), covariance
