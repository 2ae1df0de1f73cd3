"""The change of a site between two surveys."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.errors import ComparingError
from stereo_seecolor.extras.reef.comparing import m3c2
from stereo_seecolor.extras.reef.comparing.changed_patches import (
    ChangedPatch,
    Kind,
    color_patches,
    height_patches,
    is_sure,
    volume_l,
    with_tails,
)
from stereo_seecolor.extras.reef.comparing.color_change import ColorChange, color_change
from stereo_seecolor.extras.reef.comparing.difference import Difference, difference, relearned
from stereo_seecolor.extras.reef.comparing.m3c2 import SurfaceDistances, distances
from stereo_seecolor.extras.reef.comparing.registration import Registration, register
from stereo_seecolor.extras.reef.site_surface import Site, SiteMesh
from stereo_seecolor.extras.reef.terrain_of_mesh import terrain_errors, terrain_of
from stereo_seecolor.mapping.raster.grid import Grid
from stereo_seecolor.mapping.raster.terrain import Terrain, TerrainErrors
from stereo_seecolor.records import Mask

LEAST_OVERLAP_CELLS = 2000
"""Errors are learned from stable ground: of fewer cells they are not known."""
VOLUME = 3
"""With this power of lengths volumes grow, and so their errors with the calibration's."""


@dataclass(frozen=True, eq=False)
class SiteChange:
    """before, after: terrains on the first's grid. masks: (H, W) of each patch. labels: (H, W) its
    number, 0 none.

    surface: distances along the normals, (H, W) each. growth_l, loss_l: liters of the patches, each
    with its standard error.
    """

    registration: Registration
    before: Terrain
    after: Terrain
    difference: Difference
    color: ColorChange
    surface: SurfaceDistances
    patches: tuple[ChangedPatch, ...]
    masks: tuple[Mask, ...]
    labels: NDArray[np.int32]
    growth_l: tuple[float, float]
    loss_l: tuple[float, float]

    @property
    def overlap_m2(self) -> float:
        """Ground that both surveys saw."""
        return float(np.isfinite(self.difference.dz_m).sum()) * self.before.grid.cell_m**2

    @property
    def beyond_lod(self) -> float:
        """Fraction of cells that differ beyond their level of detection; 5 % without change."""
        known = np.isfinite(self.difference.dz_m)
        return float((np.abs(self.difference.dz_m) > self.difference.lod_m)[known].mean())


def compare_sites(a: Site, b: Site, cell_m: float, calibration: float) -> SiteChange:
    """Compare two surveys of a site. calibration: its relative standard error of a's lengths, to
    which b is scaled. Raises ComparingError where they cannot be registered, or hardly overlap;
    InputError if a run cannot be read.
    """
    registration = register(a, b, cell_m)
    moved = b.mesh.moved(registration.T_a_b)
    grid = _shared_grid(a.mesh, moved, cell_m)
    before, after = terrain_of(a.mesh, grid), terrain_of(moved, grid)
    a_errors = terrain_errors(a.posed, before)
    b_errors = _errors_of_moved(b, after, registration)
    found = difference(before, after, a_errors, b_errors, registration)
    if np.isfinite(found.dz_m).sum() < LEAST_OVERLAP_CELLS:
        raise ComparingError(
            "the surveys overlap too little: errors are estimated from ground that both show"
        )
    color = color_change(before, after)
    surface = _surface(a.mesh, moved, before, (a_errors, b_errors), found)
    masks = height_patches(found, surface, cell_m)
    found = relearned(
        found, np.any([mask for _, mask in masks], axis=0) if masks else np.zeros(grid.shape, bool)
    )
    surface = m3c2.relearned(surface, found.stable)
    masks = [region for region in masks if is_sure(found, region[1], cell_m)]
    masks += color_patches(color.z, color.change)
    moved_masks = [mask for kind, mask in masks if kind in ("growth", "loss")]
    changed = np.logical_or.reduce([np.zeros(grid.shape, bool), *moved_masks])
    patches = tuple(
        _patch(number, region, found, changed, color, grid, a.posed.offset_m)
        for number, region in enumerate(masks, 1)
    )
    return SiteChange(
        registration=registration,
        before=before,
        after=after,
        difference=found,
        color=color,
        surface=surface,
        patches=tuple(
            replace(
                patch,
                volume_std_l=float(
                    np.hypot(patch.volume_std_l, VOLUME * calibration * patch.volume_l)
                ),
            )
            for patch in patches
        ),
        masks=tuple(mask for _, mask in masks),
        labels=_labels(grid, masks),
        growth_l=_total(patches, "growth", calibration),
        loss_l=_total(patches, "loss", calibration),
    )


def _errors_of_moved(b: Site, after: Terrain, at: Registration) -> TerrainErrors:
    """The standard errors of b's terrain in a's coordinates, by b's own ranges."""
    grid, T = after.grid, at.T_a_b / at.scale
    T[3, 3] = 1.0
    own = Grid(grid.west_m / at.scale, grid.north_m / at.scale, grid.cell_m / at.scale, grid.shape)
    errors = terrain_errors(b.posed, Terrain(own, after.height_m / at.scale, after.color), T)
    return replace(
        errors,
        std_m=at.scale * errors.std_m,
        noise_m=at.scale * errors.noise_m,
        correlation_m=at.scale * errors.correlation_m,
    )


def _shared_grid(a: SiteMesh, b: SiteMesh, cell_m: float) -> Grid:
    """The cells of a's grid over which b lies too."""
    low = np.maximum(a.points_m.min(axis=0), b.points_m.min(axis=0))
    high = np.minimum(a.points_m.max(axis=0), b.points_m.max(axis=0))
    if (high[:2] - low[:2] < 3 * cell_m).any():
        raise ComparingError("the surveys do not overlap")
    return Grid.around(low, high, cell_m)


def _surface(
    a: SiteMesh,
    b: SiteMesh,
    before: Terrain,
    errors: tuple[TerrainErrors, TerrainErrors],
    difference: Difference,
) -> SurfaceDistances:
    """Distances at the cells of the terrain; errors grow as heights' do on stable ground."""
    shape, known = before.grid.shape, np.isfinite(difference.dz_m)
    stds = errors[0].std_m[known], errors[1].std_m[known], difference.shared_std_m[known]
    inflated = (difference.inflation * stds[0], difference.inflation * stds[1], stds[2])
    at_cells = distances(a, b, before.points_m[known], inflated, before.grid.cell_m)
    fields = []
    for values in (at_cells.distance_m, at_cells.lod_m):
        field = np.full(shape, np.nan)
        field[known] = values
        fields.append(field)
    return SurfaceDistances(*fields)


def _patch(
    number: int,
    region: tuple[Kind, Mask],
    difference: Difference,
    moved: Mask,
    color: ColorChange,
    grid: Grid,
    offset_m: NDArray[np.float64],
) -> ChangedPatch:
    kind, mask = region
    rows, columns = np.nonzero(mask)
    dz = difference.dz_m[mask & np.isfinite(difference.dz_m)]
    volume, std = (
        volume_l(difference, mask | (with_tails(mask) & ~moved), grid.cell_m)
        if kind in ("growth", "loss")
        else (float("nan"), float("nan"))
    )
    lightness, chroma = np.nanmean(color.change[mask], axis=0)
    x_m, y_m = grid.center(float(columns.mean()), float(rows.mean()))
    return ChangedPatch(
        number=number,
        kind=kind,
        x_m=x_m + offset_m[0],
        y_m=y_m + offset_m[1],
        area_cm2=1e4 * float(mask.sum()) * grid.cell_m**2,
        mean_m=float(dz.mean()) if len(dz) else float("nan"),
        most_m=float(dz[np.abs(dz).argmax()]) if len(dz) else float("nan"),
        volume_l=volume,
        volume_std_l=std,
        lightness=float(lightness),
        chroma=float(chroma),
    )


def _labels(grid: Grid, masks: list[tuple[Kind, Mask]]) -> NDArray[np.int32]:
    """Changes of color first: where the ground rose or sank too, that is what a cell shows."""
    labels = np.zeros(grid.shape, np.int32)
    for number, (_, mask) in reversed(list(enumerate(masks, 1))):
        labels[mask] = number
    return labels


def _total(
    patches: tuple[ChangedPatch, ...], kind: Kind, calibration: float
) -> tuple[float, float]:
    """Liters of all patches of a kind, whose own errors are independent, and their standard error
    with the calibration's, which they share.
    """
    own = [patch for patch in patches if patch.kind == kind]
    total = sum(patch.volume_l for patch in own)
    stds = [patch.volume_std_l for patch in own]
    return total, float(np.linalg.norm([*stds, VOLUME * calibration * total]))
