"""Changes of color: the second survey's colors are matched to the first's over what has not
changed, then compared in CIELAB.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.robust_statistics import TUKEY, biweight
from stereo_seecolor.files.srgb import decode_srgb, encode_srgb
from stereo_seecolor.mapping.raster.terrain import Terrain
from stereo_seecolor.records import Mask

Float = NDArray[np.float32]
REACH_CELLS = 8
"""Matching and voxels blend a rim with what lies within so many cells of it."""


NORMAL_80 = 1.281552
"""Two-sided 80 % of a normal distribution: up to a sixth of the ground may have changed."""


@dataclass(frozen=True)
class ColorSettings:
    """When colors differ."""

    rounds: int = 8  # of the fit between both surveys' colors
    window_cells: int = 7  # colors are averaged over it: details need not meet to the cell
    # CIELAB units: colors of one spot seldom differ less from dive to dive
    least_sigma: float = 2.0


SETTINGS = ColorSettings()


@dataclass(frozen=True, eq=False)
class ColorChange:
    """The change of color.

    delta_e: (H, W) distance in CIELAB (CIE 1976) after both were averaged over a window. change:
    (H, W, 2) of lightness, chroma. z:
    delta_e in units of what is sure: patches begin at PatchSettings' sigmas. b_as_a: (H, W, 3) b's
    colors as a's, 0..255.
    """

    delta_e: Float
    change: Float
    z: NDArray[np.float64]
    b_as_a: Float


def color_change(a: Terrain, b: Terrain) -> ColorChange:
    """Compare the colors of two terrains on one grid."""
    known = np.isfinite(a.color[..., 0]) & np.isfinite(b.color[..., 0])
    linear_a, linear_b = (decode_srgb(np.nan_to_num(terrain.color) / 255) for terrain in (a, b))
    mapped = encode_srgb(np.clip(_brought(linear_a, linear_b, known), 0, 1).astype(np.float32))
    lab_a, lab_b = (
        _smooth_lab(colors, known) for colors in (encode_srgb(linear_a.astype(np.float32)), mapped)
    )
    delta_e = np.linalg.norm(lab_b - lab_a, axis=-1)
    chroma = np.hypot(lab_b[..., 1], lab_b[..., 2]) - np.hypot(lab_a[..., 1], lab_a[..., 2])
    change = np.stack([lab_b[..., 0] - lab_a[..., 0], chroma], axis=-1)
    usual = max(float(np.quantile(delta_e[known], 0.8)) / NORMAL_80, SETTINGS.least_sigma)
    z = np.where(known, delta_e / usual, 0).astype(np.float64)
    unknown = ~known
    delta_e[unknown], change[unknown] = np.nan, np.nan
    return ColorChange(
        delta_e.astype(np.float32), change.astype(np.float32), z, (255 * mapped).astype(np.float32)
    )


def _brought(a: NDArray[np.floating], b: NDArray[np.floating], known: Mask) -> NDArray[np.floating]:
    """b's linear colors through the affine map (3 x 4) that most cells agree on: a light, water
    parameters, a white point of its own.
    """
    basis = np.concatenate([b[known], np.ones((int(known.sum()), 1))], axis=1)
    target, weight = a[known], np.ones(len(basis))
    M = np.zeros((4, 3))
    for _ in range(SETTINGS.rounds):
        scaled = basis * weight[:, None]
        M = np.linalg.lstsq(scaled.T @ basis, scaled.T @ target, rcond=None)[0]
        off = np.linalg.norm(basis @ M - target, axis=1)
        weight = biweight(off / max(TUKEY * float(np.median(off)), 1e-9))
    return np.asarray(b @ M[:3] + M[3])


def _smooth_lab(color: Float, known: Mask) -> Float:
    """(H, W, 3) CIELAB of sRGB in 0..1, averaged over a window of what is known."""
    size = (SETTINGS.window_cells,) * 2
    share = cv2.blur(known.astype(np.float32), size)
    mean = (
        cv2.blur(color * known[..., None].astype(np.float32), size)
        / np.maximum(share, 1e-6)[..., None]
    )
    return np.asarray(cv2.cvtColor(mean.astype(np.float32), cv2.COLOR_RGB2LAB))
