"""Patches: connected ground that rose, sank or changed its color, with areas and volumes."""

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.extras.reef.comparing.color_change import REACH_CELLS
from stereo_seecolor.extras.reef.comparing.difference import SETTINGS as DIFFERENCE
from stereo_seecolor.extras.reef.comparing.difference import Difference
from stereo_seecolor.extras.reef.comparing.m3c2 import SurfaceDistances
from stereo_seecolor.records import Array, Mask

Kind = Literal["growth", "loss", "paler", "darker", "other color"]


@dataclass(frozen=True)
class PatchSettings:
    """When changed ground is a patch."""

    # of a mean over a window: somewhere in a patch it is at least so far off
    seed_sigmas: float = 5.0
    # and everywhere so far, or in a mean over a wide window; since that reaches beyond a patch,
    edge_sigmas: float = 2.5
    faint_sigmas: float = 1.0  # then by itself so far, and
    faint_fraction: float = 0.3  # by so much of the most that is found within the wide window
    fewest_cells: int = 25  # a window: smaller ones are errors of single cells
    fewest_color_cells: int = 98  # two windows of colors
    # its volume over its standard error: a site has hundreds of places for a patch, and three are
    # met by chance
    sure_sigmas: float = 5.0
    # of its cells beyond their level of detection have a distance along the normal, and
    seen: float = 0.1
    # of those also differ along the normal: at an edge, heights differ where nothing moved
    on_surface: float = 0.5


PATCH_SETTINGS = PatchSettings()


EDGE = np.ones((DIFFERENCE.wide_cells, DIFFERENCE.wide_cells), np.uint8)
"""How far the edge of a patch is uncertain: half of the wide window to either side."""


@dataclass(frozen=True)
class ChangedPatch:
    """A patch of changed ground.

    number: in height_change.tif. x_m, y_m: of its middle, in the first survey's world. area_cm2: in
    plan. mean_m, most_m: change of height. volume_l: liters more than before, with its standard
    error; NaN for a change of color. lightness, chroma: change of CIELAB's L* and C*, mean over the
    patch.
    """

    number: int
    kind: Kind
    x_m: float
    y_m: float
    area_cm2: float
    mean_m: float
    most_m: float
    volume_l: float
    volume_std_l: float
    lightness: float
    chroma: float


def height_patches(
    difference: Difference, surface: SurfaceDistances, cell_m: float
) -> list[tuple[Kind, Mask]]:
    """Growth and loss of sure volume, which the distances along the normal (H, W) show too."""
    with np.errstate(invalid="ignore"):
        clear = np.abs(difference.dz_m) > difference.lod_m
    known = clear & np.isfinite(surface.distance_m)
    moved = np.abs(np.nan_to_num(surface.distance_m)) > np.nan_to_num(surface.lod_m)
    z, wide = difference.significance, difference.wide_significance
    kept: list[tuple[Kind, Mask]] = []
    kinds: tuple[tuple[Kind, Array, Array], ...] = (("growth", z, wide), ("loss", -z, -wide))
    for kind, narrow, faint in kinds:
        for mask in _regions(
            np.maximum(narrow, faint), _inside(narrow, faint), PATCH_SETTINGS.fewest_cells
        ):
            volume, std = volume_l(difference, mask, cell_m)
            tail, _ = volume_l(difference, with_tails(mask) & ~mask, cell_m)
            # where something tall is gone, few cylinders reach both surfaces
            seen = (mask & known).sum()
            agrees = (
                seen >= PATCH_SETTINGS.seen * (mask & clear).sum()
                and moved[mask & known].sum() > PATCH_SETTINGS.on_surface * seen
            )
            if abs(volume) > PATCH_SETTINGS.sure_sigmas * float(np.hypot(std, tail)) and agrees:
                kept.append((kind, mask))
    return kept


def is_sure(difference: Difference, mask: Mask, cell_m: float) -> bool:
    """Whether the volume that is stated of a patch is so many of its errors, as they are known once
    patches were left out of what shows them.
    """
    volume, std = volume_l(difference, with_tails(mask), cell_m)
    return abs(volume) > PATCH_SETTINGS.sure_sigmas * std


def _inside(narrow: Array, wide: Array) -> Mask:
    """(H, W) what may belong to a patch, by the means over both windows."""
    most = cv2.dilate(narrow, np.ones((DIFFERENCE.wide_cells, DIFFERENCE.wide_cells)))
    least = np.maximum(PATCH_SETTINGS.faint_sigmas, PATCH_SETTINGS.faint_fraction * most)
    return np.asarray(
        (narrow > PATCH_SETTINGS.edge_sigmas)
        | ((wide > PATCH_SETTINGS.edge_sigmas) & (narrow > least))
    )


def with_tails(mask: Mask) -> Mask:
    """A patch with what lies just outside: the tails of a change are below what is detected."""
    return np.asarray(cv2.dilate(mask.astype(np.uint8), EDGE) > 0)


def volume_l(difference: Difference, cells: Mask, cell_m: float) -> tuple[float, float]:
    """Liters over some cells and their standard error: of errors that the cells share, and of the
    registration's, which all share.

    A patch is found where errors are largest. Those of cells that are known worse than most, as at
    a rim that matching blends, are one error within REACH_CELLS, which the average of the site
    does not show.
    """
    known = cells & np.isfinite(difference.dz_m)
    alike = difference.alike(max(int(known.sum()), 1))
    std_m = np.where(known, difference.std_m, 0.0)
    typical_m = np.median(difference.std_m[np.isfinite(difference.std_m)])
    rims_m = np.where(std_m > typical_m, std_m, 0.0)
    disk = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * REACH_CELLS + 1,) * 2)
    together = cv2.filter2D(rims_m, -1, disk.astype(np.float64), borderType=cv2.BORDER_CONSTANT)
    variance = max(alike * float((std_m**2).sum()), float((rims_m * together).sum()))
    variance += float(difference.shared_std_m[known].sum()) ** 2
    return 1000 * cell_m**2 * float(difference.dz_m[known].sum()), 1000 * cell_m**2 * variance**0.5


def color_patches(z: Array, change: NDArray[np.float32]) -> list[tuple[Kind, Mask]]:
    """Find patches of changed color. z: (H, W) color change in spreads of stable ground. change:
    (H, W, 2) of lightness and chroma.
    """
    regions = _regions(z, z > PATCH_SETTINGS.edge_sigmas, PATCH_SETTINGS.fewest_color_cells)
    return [(_color_kind(change[mask]), mask) for mask in regions]


def _color_kind(change: NDArray[np.float32]) -> Kind:
    lightness, chroma = np.nanmean(change, axis=0)
    if abs(lightness) < 0.5 * abs(chroma):
        return "other color"
    return "paler" if lightness > 0 else "darker"


def _regions(z: Array, inside: Mask, fewest: int) -> list[Mask]:
    """Connected cells whose z (H, W) reaches seed_sigmas somewhere, and not too few."""
    count, labels = cv2.connectedComponents(inside.astype(np.uint8))
    seeds = np.unique(labels[z > PATCH_SETTINGS.seed_sigmas])
    sizes = np.bincount(labels.ravel(), minlength=count)
    return [labels == number for number in seeds if number and sizes[number] >= fewest]
