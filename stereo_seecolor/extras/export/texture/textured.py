"""A surface with its texture, page by page."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.export.texture.painting import PageMesh, level, pack, page_mesh, paint
from stereo_seecolor.extras.export.texture.surface import Surface, neighbors, read_surface
from stereo_seecolor.extras.export.texture.views import (
    Charts,
    Views,
    build_charts,
    candidates,
    choose,
)
from stereo_seecolor.run_folder.posed_run import PosedRun


@dataclass(frozen=True, eq=False)
class Textured:
    """group (F,): pages hold triangles of one group each."""

    views: Views
    surface: Surface
    charts: Charts
    group: NDArray[np.int64]

    def pages(self, group: int = 0, step: int = 1) -> Iterator[tuple[PageMesh, NDArray[np.uint8]]]:
        """A group's triangles and their textures (H, W, 3) RGB. step: pixels of the images to one
        of the texture.

        Raises InputError if an image is gone or damaged.
        """
        own = np.flatnonzero((self.group == group) & (self.charts.of_face >= 0))
        order = own[np.argsort(self.charts.of_face[own], kind="stable")]
        counts = np.bincount(self.charts.of_face[order], minlength=len(self.charts.view))
        of_chart = np.split(order, np.cumsum(counts)[:-1]) if len(counts) else []
        unseen = np.flatnonzero((self.group == group) & (self.charts.of_face < 0))
        for page in pack(self.charts, group, unseen, step):
            mesh = page_mesh(self.charts, page, self.surface.triangles, of_chart)
            yield mesh, paint(self.views, self.surface, self.charts, page, of_chart)

    @property
    def summary(self) -> str:
        """The outcome of the map's surface, for a person."""
        surface, pixel_mm = self.surface, 1000 * self.views.posed.pixel_m
        largest_mm, bound_mm, rms_mm = (
            1000 * value for value in (surface.largest_m, surface.bound_m, surface.rms_m)
        )
        seen, frames = float((self.charts.of_face >= 0).mean()), len(np.unique(self.charts.view))
        return (
            f"{len(surface.triangles):,} of {surface.original:,} triangles; the map's vertices "
            f"lie at most {largest_mm:.2f} mm "
            f"from them (bound {bound_mm:.2f} mm, rms {rms_mm:.2f} mm); texture at the images' "
            f"{pixel_mm:.2f} mm a pixel "
            f"from {frames} frames, on {seen:.1%} of the triangles"
        )


def open_surface(posed: PosedRun) -> Surface:
    """The run's mesh, with as few triangles as the bound allows. Raises InputError if it is
    empty.
    """
    surface = read_surface(posed)
    if not len(surface.triangles):
        raise InputError(f"{posed.map_folder}: its mesh has no triangles")
    return surface


def textured(posed: PosedRun, surface: Surface, group: NDArray[np.int64] | None = None) -> Textured:
    """Choose views, cut charts and level their seams. group (F,): zeros if None. Raises InputError
    as Views.image.
    """
    views, across = Views(posed), neighbors(surface.triangles)
    of_face = np.zeros(len(surface.triangles), np.int64) if group is None else group
    label = choose(candidates(views, surface), across)
    charts = level(views, surface, build_charts(views, surface, label, across, of_face), across)
    return Textured(views, surface, charts, of_face)
