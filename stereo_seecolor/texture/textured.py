"""The surface of a map with the images on it: a view for each triangle, and pages of texture."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.texture.charts import Charts, build_charts
from stereo_seecolor.texture.choice import choose
from stereo_seecolor.texture.painting import PageMesh, pack, page_mesh, paint
from stereo_seecolor.texture.seams import level
from stereo_seecolor.texture.surface import PaintedSurface, neighbors
from stereo_seecolor.texture.views import Views, candidates


@dataclass(frozen=True, eq=False)
class Textured:
    """group (F,): pages hold triangles of one group each."""

    views: Views
    surface: PaintedSurface
    charts: Charts
    group: NDArray[np.int64]

    def pages(self, group: int = 0, step: int = 1) -> Iterator[tuple[PageMesh, NDArray[np.uint8]]]:
        """A group's triangles and textures (H, W, 3) RGB. step: image pixels to one of these."""
        own = np.flatnonzero((self.group == group) & (self.charts.of_face >= 0))
        order = own[np.argsort(self.charts.of_face[own], kind="stable")]
        counts = np.bincount(self.charts.of_face[order], minlength=len(self.charts.view))
        of_chart = np.split(order, np.cumsum(counts)[:-1]) if len(counts) else []
        unseen = np.flatnonzero((self.group == group) & (self.charts.of_face < 0))
        for page in pack(self.charts, group, unseen, step):
            mesh = page_mesh(self.charts, page, self.surface.triangles, of_chart)
            yield mesh, paint(self.views, self.surface, self.charts, page, of_chart)


def textured(
    views: Views, surface: PaintedSurface, group: NDArray[np.int64] | None = None
) -> Textured:
    """Choose views, cut charts and level their seams. group (F,): zeros if None."""
    across = neighbors(surface.triangles)
    of_face = np.zeros(len(surface.triangles), np.int64) if group is None else group
    label = choose(candidates(views, surface), across)
    charts = level(views, surface, build_charts(views, surface, label, across, of_face), across)
    return Textured(views, surface, charts, of_face)
