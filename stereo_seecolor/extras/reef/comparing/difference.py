"""The difference of two terrains, cell by cell, with standard errors calibrated on stable ground.

The errors of both terrains, also beside their holes, and of the registration add up. What they do
not know, such as voxels that fall differently on rough ground, is read off ground that did not
change: the spread of differences there, against what the errors say, as a function of what they say
(Hugonnet et al. 2022, IEEE JSTARS 15; the same for slopes), and of how many more frames one survey
has there: maps of the same frames, or of frames that lie alike, are off alike. The level of
detection is then 1.96 standard errors.
"""

from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.robust_statistics import deviation_about_zero
from stereo_seecolor.extras.reef.comparing.registration import Registration
from stereo_seecolor.mapping.raster.height_errors import stds_beside_holes
from stereo_seecolor.mapping.raster.terrain import Terrain, TerrainErrors
from stereo_seecolor.records import Array, Mask

NORMAL_95 = 1.959964
"""Two-sided 95 % of a normal distribution, in standard deviations."""


@dataclass(frozen=True)
class DifferenceSettings:
    """How errors are learned from stable ground."""

    # standard error of where a surface lies sideways, cells: voxels round it off (1 / sqrt 12)
    slope_cells: float = 0.3
    bins: int = 8  # of the stated standard error
    fewest: int = 200  # cells in a bin: its 95 % quantile is then known to 2 % of the cells
    window_cells: int = 5  # differences are averaged over it to tell change from noise,
    wide_cells: int = 9  # and over this where a change is faint
    # squares for which it is learned how many cells share one error
    sharing_cells: tuple[int, ...] = (5, 11, 21, 41)
    sharing_stable: float = 0.7  # of such a square must be stable
    # such squares side by side, or larger ones are taken to be as the last
    sharing_fewest: int = 10
    change_sigmas: float = 4.0  # of such a mean, beyond which ground is not taken to be stable
    grow_cells: int = 3  # around it neither
    rounds: int = 3


SETTINGS = DifferenceSettings()


@dataclass(frozen=True, eq=False)
class Difference:
    """The difference of two terrains. dz_m: (H, W) b less a, NaN where either is unknown. std_m:
    its standard error. stable: not changed.

    inflation: by how much more than stated the differences of stable ground spread, median over the
    cells. shared_std_m: (H, W) the part of std_m that all cells share, the registration's.
    significance, wide_significance: (H, W) means over a window, and a wide one, in spreads of such
    means on stable ground, 0 where unknown. sharing: (K, 2) cells of a square, and how many of its
    cells share one error: ranges, tracks and registrations are off together over much more than a
    cell. more_frames: (H, W) 0 where both surveys saw the ground in as many frames, 1 where one saw
    it in more, 2 where in twice as many or more; None where that is not known.
    """

    dz_m: Array
    std_m: Array
    stable: Mask
    inflation: float
    shared_std_m: Array
    significance: Array
    wide_significance: Array
    sharing: Array
    more_frames: NDArray[np.int64] | None = None

    @property
    def lod_m(self) -> Array:
        """The level of detection at 95 %: (H, W), 1.96 standard errors."""
        return np.asarray(NORMAL_95 * self.std_m)

    @property
    def median_lod_m(self) -> float:
        """The median level of detection of the cells that both dives know."""
        return float(np.nanmedian(self.lod_m))

    def alike(self, cells: int) -> float:
        """How many of a patch's ``cells`` share one error, as measured on stable ground."""
        return float(np.interp(np.log(cells), np.log(self.sharing[:, 0]), self.sharing[:, 1]))


def difference(
    a: Terrain,
    b: Terrain,
    a_errors: TerrainErrors,
    b_errors: TerrainErrors,
    registration: Registration,
) -> Difference:
    """Subtract two terrains on one grid."""
    dz = b.height_m - a.height_m
    shared = registration.std_m(np.nan_to_num(a.points_m), np.nan_to_num(a.slopes))
    sideways = SETTINGS.slope_cells * a.grid.cell_m * np.maximum(_steepness(a), _steepness(b))
    holes = np.hypot(stds_beside_holes(a.height_m), stds_beside_holes(b.height_m))
    stated = np.sqrt(a_errors.std_m**2 + b_errors.std_m**2 + shared**2 + sideways**2 + holes**2)
    known = np.isfinite(dz) & np.isfinite(stated)
    dz, stable, factor = np.where(known, dz, np.nan), known, np.ones_like(dz)
    views = a_errors.views, b_errors.views
    most, least = np.maximum(*views), np.minimum(*views)
    more = np.where(most >= 2 * least, 2, 1) * (most > least)
    for _ in range(SETTINGS.rounds):
        factor = spread_by(np.abs(dz) / stated, stated, stable, more)
        stable = known & ~_changed(dz, stated * factor, stable, more)
    std = np.where(known, stated * factor, np.nan)
    inflation = float(np.median(factor[known])) if known.any() else float("nan")
    return Difference(
        dz,
        std,
        stable,
        inflation,
        np.where(known, shared, np.nan),
        *in_spreads(dz, std, stable, more),
        more,
    )


def relearned(difference: Difference, changed: Mask) -> Difference:
    """Estimate the errors again from all ground but what certainly changed, known only at the end.

    While patches were looked for, ground that differed much was left out, whether it had changed or
    its errors were large.
    """
    known = np.isfinite(difference.dz_m)
    stable = known & ~_around(changed)
    if not stable.any():
        return difference
    std = difference.std_m
    for _ in range(SETTINGS.rounds):  # between the bins' middles a first round only comes near
        size = np.abs(difference.dz_m) / std
        std = std * spread_by(size, std, stable, difference.more_frames)
    inflation = difference.inflation * float(np.median((std / difference.std_m)[known]))
    return Difference(
        difference.dz_m,
        std,
        stable,
        inflation,
        difference.shared_std_m,
        *in_spreads(difference.dz_m, std, stable, difference.more_frames),
        difference.more_frames,
    )


def _steepness(terrain: Terrain) -> Array:
    east, north = np.nan_to_num(terrain.slopes)
    return np.asarray(np.hypot(east, north))


def spread_by(
    size: Array, std: Array, stable: Mask, more_frames: NDArray[np.int64] | None = None
) -> Array:
    """Estimate the spread of what should be of unit spread, as a function of std: (H, W), such that
    95 % of stable ground lie within 1.96, and as many of each kind of ``more_frames`` that holds
    enough of it. size: (H, W) absolute values.
    """
    spread = _spread_by_std(size, std, stable)
    if more_frames is not None:
        for own in (more_frames == times for times in range(3)):
            if (stable & own).sum() >= SETTINGS.fewest:
                spread[own] = np.maximum(spread, _spread_by_std(size, std, stable & own))[own]
    return spread


def _spread_by_std(size: Array, std: Array, stable: Mask) -> Array:
    """A value for each bin of std, interpolated between."""
    used = stable & np.isfinite(std) & np.isfinite(size)
    bins = int(min(SETTINGS.bins, used.sum() // SETTINGS.fewest))
    if bins < 1:
        return np.ones_like(std)
    edges = np.quantile(std[used], np.linspace(0, 1, bins + 1))
    centers, factors = [], []
    for low, high in pairwise(edges):
        own = used & (std >= low) & (std <= high)
        centers.append(float(np.median(std[own])))
        factors.append(max(float(np.quantile(size[own], 0.95)) / NORMAL_95, 1e-9))
    return np.asarray(np.interp(np.nan_to_num(std), centers, factors))


def in_spreads(
    dz: Array, std: Array, stable: Mask, more_frames: NDArray[np.int64] | None = None
) -> tuple[Array, Array, Array]:
    """Compute means of differences over both windows, in units of the spread of such means on
    stable ground: (H, W) each; and the sharing of errors (K, 2).
    """
    narrow, wide = (
        _significance(dz, std, stable, cells, more_frames)
        for cells in (SETTINGS.window_cells, SETTINGS.wide_cells)
    )
    return narrow, wide, _sharing(dz, std, stable)


def _significance(
    dz: Array, std: Array, stable: Mask, cells: int, more_frames: NDArray[np.int64] | None
) -> Array:
    z = window_mean(dz, std, cells)
    return np.nan_to_num(z / spread_by(np.abs(z), std, stable, more_frames))


def _sharing(dz: Array, std: Array, stable: Mask) -> Array:
    """Variances of means over squares of stable ground, in those of independent errors (Hugonnet et
    al. 2022, eq. 15).
    """
    own, found = np.where(stable, dz, np.nan), [(1.0, 1.0)]
    for cells in SETTINGS.sharing_cells:
        full = (
            cv2.boxFilter(stable.astype(np.float64), -1, (cells, cells)) > SETTINGS.sharing_stable
        )
        inside = full & stable
        if inside.sum() < SETTINGS.sharing_fewest * cells**2:
            break
        variance = deviation_about_zero(window_mean(own, std, cells)[inside]) ** 2
        found.append((float(cells**2), max(variance, found[-1][1])))
    return np.array(found)


def _changed(dz: Array, std: Array, stable: Mask, more_frames: NDArray[np.int64]) -> Mask:
    """Where a window's mean is further off than on stable ground; and around that."""
    z = _significance(dz, std, stable, SETTINGS.window_cells, more_frames)
    return _around(np.abs(z) > SETTINGS.change_sigmas)


def _around(changed: Mask) -> Mask:
    size = 2 * SETTINGS.grow_cells + 1
    return np.asarray(
        cv2.dilate(
            changed.astype(np.uint8), cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
        )
        > 0
    )


def window_mean(dz: Array, std: Array, cells: int) -> Array:
    """Compute the sum of dz / std^2 over a window, over the square root of the sum of 1 / std^2:
    (H, W), NaN where dz is unknown.
    """
    known = np.isfinite(dz) & np.isfinite(std)
    weight = np.where(known, 1 / np.where(known, std, 1) ** 2, 0)
    total = cv2.boxFilter(weight * np.where(known, dz, 0), -1, (cells, cells), normalize=False)
    norm = np.sqrt(np.maximum(cv2.boxFilter(weight, -1, (cells, cells), normalize=False), 0))
    return np.where(known, total / np.maximum(norm, 1e-12), np.nan)
