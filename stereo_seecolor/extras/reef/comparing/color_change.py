"""Changes of color: the second survey's colors are matched to the first's over what has not
changed, then compared in CIELAB.
"""

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.extras.reef.comparing.difference import SETTINGS as DIFFERENCE
from stereo_seecolor.extras.reef.comparing.difference import Difference
from stereo_seecolor.extras.reef.comparing.m3c2 import SurfaceDistances
from stereo_seecolor.files.srgb import decode_srgb, encode_srgb
from stereo_seecolor.mapping.raster.height_model import Terrain
from stereo_seecolor.robust_statistics import TUKEY, biweight

Float = NDArray[np.float32]
Mask = NDArray[np.bool_]
REACH_CELLS = 8
"""Matching and voxels blend a rim with what lies within so many cells of it."""


NORMAL_80 = 1.281552
"""Two-sided 80 % of a normal distribution, in standard deviations: up to a sixth of the ground may
have changed.
"""


@dataclass(frozen=True)
class ColorSettings:
    """When colors differ."""

    rounds: int = 8  # of the fit between both surveys' colors
    window_cells: int = 7  # colors are averaged over it: details need not meet to the cell
    # CIELAB units: colors of one spot seldom differ less from dive to dive
    least_sigma: float = 2.0


COLOR_CHANGE_SETTINGS = ColorSettings()


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
    usual = max(
        float(np.quantile(delta_e[known], 0.8)) / NORMAL_80, COLOR_CHANGE_SETTINGS.least_sigma
    )
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
    for _ in range(COLOR_CHANGE_SETTINGS.rounds):
        scaled = basis * weight[:, None]
        M = np.linalg.lstsq(scaled.T @ basis, scaled.T @ target, rcond=None)[0]
        off = np.linalg.norm(basis @ M - target, axis=1)
        weight = biweight(off / max(TUKEY * float(np.median(off)), 1e-9))
    return np.asarray(b @ M[:3] + M[3])


def _smooth_lab(color: Float, known: Mask) -> Float:
    """(H, W, 3) CIELAB of sRGB in 0..1, averaged over a window of what is known."""
    size = (COLOR_CHANGE_SETTINGS.window_cells,) * 2
    share = cv2.blur(known.astype(np.float32), size)
    mean = (
        cv2.blur(color * known[..., None].astype(np.float32), size)
        / np.maximum(share, 1e-6)[..., None]
    )
    return np.asarray(cv2.cvtColor(mean.astype(np.float32), cv2.COLOR_RGB2LAB))


# Patches: connected ground that rose, sank or changed its color, with areas and volumes.

Array = NDArray[np.float64]

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
    found: Difference, surface: SurfaceDistances, cell_m: float
) -> list[tuple[Kind, Mask]]:
    """Growth and loss whose volume is sure, and which the distances along the normal (H, W) show
    too.
    """
    with np.errstate(invalid="ignore"):
        clear = np.abs(found.dz_m) > found.lod_m
    known = clear & np.isfinite(surface.distance_m)
    moved = np.abs(np.nan_to_num(surface.distance_m)) > np.nan_to_num(surface.lod_m)
    z, wide = found.significance, found.wide_significance
    kept: list[tuple[Kind, Mask]] = []
    kinds: tuple[tuple[Kind, Array, Array], ...] = (("growth", z, wide), ("loss", -z, -wide))
    for kind, narrow, faint in kinds:
        for mask in _regions(
            np.maximum(narrow, faint), _inside(narrow, faint), PATCH_SETTINGS.fewest_cells
        ):
            volume, std = volume_l(found, mask, cell_m)
            tail, _ = volume_l(found, with_tails(mask) & ~mask, cell_m)
            # where something tall is gone, few cylinders reach both surfaces
            seen = (mask & known).sum()
            agrees = (
                seen >= PATCH_SETTINGS.seen * (mask & clear).sum()
                and moved[mask & known].sum() > PATCH_SETTINGS.on_surface * seen
            )
            if abs(volume) > PATCH_SETTINGS.sure_sigmas * float(np.hypot(std, tail)) and agrees:
                kept.append((kind, mask))
    return kept


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


def volume_l(found: Difference, cells: Mask, cell_m: float) -> tuple[float, float]:
    """Liters over some cells and their standard error: of errors that the cells share, and of the
    registration's, which all share.

    A patch is found where errors are largest. Those of cells that are known worse than most, as at
    a rim that matching blends, are one error within REACH_CELLS, which the average of the site
    does not show.
    """
    known = cells & np.isfinite(found.dz_m)
    alike = found.alike(max(int(known.sum()), 1))
    std_m = np.where(known, found.std_m, 0.0)
    typical_m = np.median(found.std_m[np.isfinite(found.std_m)])
    rims_m = np.where(std_m > typical_m, std_m, 0.0)
    disk = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * REACH_CELLS + 1,) * 2)
    together = cv2.filter2D(rims_m, -1, disk.astype(np.float64), borderType=cv2.BORDER_CONSTANT)
    variance = max(alike * float((std_m**2).sum()), float((rims_m * together).sum()))
    variance += float(found.shared_std_m[known].sum()) ** 2
    return 1000 * cell_m**2 * float(found.dz_m[known].sum()), 1000 * cell_m**2 * variance**0.5


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
    """Connected cells of those inside whose z (H, W) reaches seed_sigmas somewhere, and that are
    not too few.
    """
    count, labels = cv2.connectedComponents(inside.astype(np.uint8))
    seeds = np.unique(labels[z > PATCH_SETTINGS.seed_sigmas])
    sizes = np.bincount(labels.ravel(), minlength=count)
    return [labels == number for number in seeds if number and sizes[number] >= fewest]
