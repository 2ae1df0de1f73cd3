"""Points of the left image placed in the right one to a fraction of a pixel, where both cameras see
a surface from different sides: small windows are moved and deformed until they agree.

In rectified images a plane keeps its rows, and its columns are shifted, scaled and sheared (d =
a x + b y + c), which is all that a window is deformed by; plain flow shifts it only, and loses the
points of slanted surfaces where the baseline is long against the range. By least squares (Gruen
1985, S. Afr. J. Photogramm. 14, 175), with brightness and contrast left open.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Values = NDArray[np.float32]


@dataclass(frozen=True)
class AlignmentLimits:
    """How windows are aligned, and which of them agree.

    half_px: of a window; smaller ones are less sure of the row in compressed video (median error
    of .45 px with 15, .35 px with 20: synthetic reef, 860 mm, H.264), larger ones reach over steps.
    smoothing_px: standard deviation. correlation, row_std_px: of windows that agree: of two
    different scenes, 3 of 80 windows do, and 370 of 450 of one scene. moved_px: from where the
    features lie. deformed: scale and shear of columns.
    """

    half_px: int = 20
    smoothing_px: float = 1.5
    steps: int = 12
    correlation: float = 0.8
    row_std_px: float = 0.12
    moved_px: float = 4.0
    deformed: float = 0.8


LIMITS = AlignmentLimits()
_MOST_A_STEP = np.array([1.5, 1.5, 0.15, 0.15], np.float32)  # column, row, scale, shear
_AT_ONCE = 128  # windows, which take 60 MB


def align(
    first: NDArray[np.uint8], second: NDArray[np.uint8], at_first: Array, at_second: Array
) -> tuple[Array, NDArray[np.bool_]]:
    """Align the windows around points (n, 2) of the first image with those of the second: (n, 2)
    pixels of the second image, and (n,) whether the windows agree.
    """
    smooth = [
        cv2.GaussianBlur(image, (0, 0), LIMITS.smoothing_px).astype(np.float32)
        for image in (first, second)
    ]
    moved, agree = at_second.astype(np.float64), np.zeros(len(at_second), bool)
    for start in range(0, len(at_first), _AT_ONCE):
        part = slice(start, start + _AT_ONCE)
        by, agree[part] = _aligned(smooth[0], smooth[1], at_first[part], at_second[part])
        moved[part] += by
    return moved, agree


def _aligned(
    first: Values, second: Values, at_first: Array, at_second: Array
) -> tuple[Array, NDArray[np.bool_]]:
    half = LIMITS.half_px
    v, u = (
        grid.ravel().astype(np.float32) for grid in np.mgrid[-half : half + 1, -half : half + 1]
    )
    weights = np.exp(-(u**2 + v**2) / (half**2 * 0.9)).astype(np.float32)
    pixels = weights.sum()
    weights /= pixels
    slopes = [cv2.Sobel(second, cv2.CV_32F, *axis, ksize=3) / 8 for axis in ((1, 0), (0, 1))]
    x, y = (at.astype(np.float32) for at in at_first.T[..., None])
    wanted, _ = _standard(_seen(first, x + u, y + v), weights)
    x, y = (at.astype(np.float32) for at in at_second.T[..., None])
    change = np.zeros((len(at_first), 4), np.float32)  # column, row, scale and shear of columns
    for step in range(LIMITS.steps + 1):
        columns = x + change[:, :1] + (1 + change[:, 2:3]) * u + change[:, 3:] * v
        rows = y + change[:, 1:2] + v
        seen, contrast = _standard(_seen(second, columns, rows), weights)
        rest = wanted - seen
        if step == LIMITS.steps:
            break
        by_x, by_y = (_seen(slope, columns, rows) / contrast for slope in slopes)
        terms = np.stack([by_x, by_y, by_x * u, by_x * v])
        terms -= (terms @ weights)[..., None]  # brightness, and contrast, explain what they can
        terms -= ((terms * seen) @ weights)[..., None] * seen
        normal = np.einsum("inp,jnp->nij", terms * weights, terms, optimize=True)
        normal += np.float32(1e-6) * np.eye(4, dtype=np.float32)
        # a window of stripes alone tells neither scale nor shear
        damping = np.trace(normal, axis1=1, axis2=2)[:, None, None] / 4000
        normal += damping * np.diag(np.array([0, 0, 1, 1], np.float32))
        right = np.einsum("inp,np->ni", terms * weights, rest, optimize=True)
        by = np.linalg.solve(normal, right[..., None])[..., 0]
        change += np.clip(by, -_MOST_A_STEP, _MOST_A_STEP)
    row_std_px = np.sqrt(np.linalg.inv(normal)[:, 1, 1] * (rest**2 @ weights) / pixels)
    agree = (
        ((wanted * seen) @ weights > LIMITS.correlation)
        & (row_std_px < LIMITS.row_std_px)
        & (np.abs(change[:, :2]).max(axis=1) < LIMITS.moved_px)
        & (np.abs(change[:, 2:]).max(axis=1) < LIMITS.deformed)
    )
    return change[:, :2].astype(np.float64), agree


def _seen(image: Values, columns: Values, rows: Values) -> Values:
    found = cv2.remap(image, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(found, np.float32)


def _standard(windows: Values, weights: Values) -> tuple[Values, Values]:
    """Windows (n, p) with mean 0 and standard deviation 1, and (n, 1) what that was."""
    centered = windows - (windows @ weights)[:, None]
    contrast = np.asarray(np.sqrt(centered**2 @ weights)[:, None] + 1e-3, np.float32)
    return np.asarray(centered / contrast, np.float32), contrast
