"""Differences of the same patch between charts at several ranges, which a correction should remove;
needs no known colors.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.extras.evaluation.charts.chart_types import ChartType
from stereo_seecolor.extras.evaluation.charts.targets import Target
from stereo_seecolor.files.srgb import LUMINANCE, decode_srgb
from stereo_seecolor.records import Map

MOST_CLIPPED = 0.1
"""Largest fraction of clipped pixels of a patch: with more, its mean is not that of the light."""


@dataclass(frozen=True, eq=False)
class SeenChart:
    """A chart corrected by a method. colors: (N, 3) linear means of its patches, NaN where a patch
    is unknown or clipped.
    """

    method: str
    type: ChartType
    range_m: float
    colors: NDArray[np.float64]


@dataclass(frozen=True)
class SpreadRow:
    """The differences between all charts of a kind, corrected by a method. nearest_m, farthest_m:
    of the charts' median ranges.

    angle_deg: mean angle between a patch's color and its mean direction over the charts, in linear
    light, after a gain for each channel makes the mean of all gray: else a method that leaves
    everything blue would score well. luminance: standard deviation of the logarithm of a patch's
    luminance over the charts, mean over patches. NaN where no patch is known on two charts.
    """

    method: str
    chart: str
    charts: int
    nearest_m: float
    farthest_m: float
    angle_deg: float
    luminance: float


def seen_chart(
    method: str,
    target: Target,
    result: NDArray[np.float64],
    range_m: Map,
    clipped_by_camera: NDArray[np.bool_],
) -> SeenChart | None:
    """The patches of a chart in a method's result (H, W, 3), in [0, 1] as displayed, NaN where
    unknown. None for a white card.

    clipped_by_camera: (H, W). Patches that the camera clipped are left out.
    """
    if target.type is None:
        return None
    colors = np.full((len(target.patches), 3), np.nan)
    for number, patch in enumerate(target.patches):
        if not patch.any() or clipped_by_camera[patch].mean() > MOST_CLIPPED:
            continue
        pixels = result[patch]
        known = pixels[np.isfinite(pixels).all(axis=-1)]
        if len(known):
            colors[number] = decode_srgb(known).mean(axis=0)
    seen = range_m[target.mask]
    median_m = float(np.nanmedian(seen)) if np.isfinite(seen).any() else float("nan")
    return SeenChart(method, target.type, median_m, colors)


def spread_over_charts(seen: Sequence[SeenChart]) -> tuple[SpreadRow, ...]:
    """A row for each method and kind of chart that was seen at least twice."""
    groups = dict.fromkeys((chart.method, chart.type.name) for chart in seen)
    members = {
        group: [chart for chart in seen if (chart.method, chart.type.name) == group]
        for group in groups
    }
    return tuple(_row(charts) for charts in members.values() if len(charts) > 1)


def _row(charts: Sequence[SeenChart]) -> SpreadRow:
    """The differences between charts of one kind, corrected by one method."""
    colors = np.stack([chart.colors for chart in charts])
    colors = colors / np.maximum(np.nanmean(colors.reshape(-1, 3), axis=0), 1e-9)
    ranges_m = [chart.range_m for chart in charts if np.isfinite(chart.range_m)] or [float("nan")]
    angles, luminances = [], []
    for patch in range(colors.shape[1]):
        values = colors[:, patch]
        known = values[np.isfinite(values).all(axis=1) & (values @ LUMINANCE > 0)]
        if len(known) > 1:
            directions = known / np.linalg.norm(known, axis=1, keepdims=True)
            mean = directions.mean(axis=0) / np.linalg.norm(directions.mean(axis=0))
            angles.append(np.degrees(np.arccos(np.clip(directions @ mean, -1, 1))).mean())
            luminances.append(np.log(known @ LUMINANCE).std())
    return SpreadRow(
        charts[0].method,
        charts[0].type.name,
        len(charts),
        min(ranges_m),
        max(ranges_m),
        float(np.mean(angles)) if angles else float("nan"),
        float(np.mean(luminances)) if luminances else float("nan"),
    )
