"""Finds color charts: large and partly visible ones by their patches, small ones by filters."""

import numpy as np

from stereo_seecolor.extras.evaluation.charts.chart_types import CHART_TYPES, FoundChart
from stereo_seecolor.extras.evaluation.charts.flat_patches import flat_patches
from stereo_seecolor.extras.evaluation.charts.lattices import lattices
from stereo_seecolor.extras.evaluation.charts.reading import read_lattice
from stereo_seecolor.extras.evaluation.charts.small_charts import small_charts
from stereo_seecolor.files.decode import eight_bit
from stereo_seecolor.records import Image


def find_charts(image: Image) -> tuple[FoundChart, ...]:
    """Every chart in an image of 8 or 16 bits, (H, W, 3) RGB, by falling score. Of overlapping
    outlines that with most patches.
    """
    picture = np.asarray(eight_bit(image) / np.float32(255), np.float32)
    grids = [lattice for patches in flat_patches(picture) for lattice in lattices(patches)]
    read = [read_lattice(picture, lattice, type) for lattice in grids for type in CHART_TYPES]
    kept: list[FoundChart] = []
    _keep(kept, [chart for chart in read if chart])
    _keep(kept, list(small_charts(picture, CHART_TYPES)))
    return tuple(sorted(kept, key=lambda chart: -chart.score))


def _keep(kept: list[FoundChart], charts: list[FoundChart]) -> None:
    """Add the charts found to those kept, unless they overlap one of them."""
    for chart in sorted(charts, key=lambda chart: (-int(chart.seen.sum()), -chart.score)):
        if not any(_overlap(chart, other) for other in kept):
            kept.append(chart)


def _overlap(one: FoundChart, other: FoundChart) -> bool:
    distance = np.hypot(*(one.corners.mean(axis=0) - other.corners.mean(axis=0)))
    return bool(
        distance
        < 0.5 * max(np.hypot(*(chart.corners[1] - chart.corners[0])) for chart in (one, other))
    )
