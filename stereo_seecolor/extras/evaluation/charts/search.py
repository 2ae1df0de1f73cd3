"""Color charts in the frames of a run: their patches before and after correction, compared with the
published colors.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration import CalibrationError
from stereo_seecolor.compute.threads import Threads, cores
from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.evaluation.charts.reading import ChartType
from stereo_seecolor.extras.evaluation.charts.targets import Target, find_charts, found_chart
from stereo_seecolor.extras.evaluation.measures import ciede2000, exposure_gain, lab_from_linear
from stereo_seecolor.extras.evaluation.truth import evaluate_spread
from stereo_seecolor.files.decode import eight_bit
from stereo_seecolor.files.srgb import LUMINANCE, decode_srgb, encode_srgb
from stereo_seecolor.progress import Listener
from stereo_seecolor.records import FrameRow, Map
from stereo_seecolor.report.frame_files import FrameFiles, ShownChart, write_charts
from stereo_seecolor.run_folder.finished_run import FinishedFrame, FinishedRun
from stereo_seecolor.run_folder.folder import RunFolder

Floats = NDArray[np.float64]


def look_for_charts(folder: RunFolder, run: FinishedRun, listener: Listener) -> None:
    """Search all frames for color charts, compare views of the same spots, and keep both results
    for the page.
    """
    found: list[ShownChart] = []
    listener.begin("charts", len(run.frames))
    for frame, charts in zip(run.frames, find_all(FrameFiles.of(run), run.frames), strict=True):
        found += charts
        listener.advance(FrameRow(frame.name))
    try:
        spread = evaluate_spread(run.root)
    except InputError:
        spread = None  # no two frames show the same, or the images are gone
    write_charts(folder, found, spread)


def find_all(
    files: FrameFiles, frames: Sequence[FinishedFrame]
) -> Iterator[tuple[ShownChart, ...]]:
    """The charts of each frame, searched on all cores; two seconds of processor time for a frame of
    1.4 megapixels.
    """

    def of(frame: FinishedFrame) -> tuple[ShownChart, ...]:
        try:
            return _seen(files, frame)
        except InputError:
            return ()

    yield from Threads(cores()).each(of, frames)


def _seen(files: FrameFiles, frame: FinishedFrame) -> tuple[ShownChart, ...]:
    """The charts in a frame's corrected image, with their colors before correction where the input
    image is there.
    """
    corrected = eight_bit(frame.read("corrected"))
    found = find_charts(corrected)
    try:
        raw = eight_bit(files.raw(frame)) if found else None
    except (InputError, CalibrationError):
        raw = None
    made = []
    for one in found:
        target = found_chart("chart", one, corrected.shape[:2])
        after, after_difference = patch_colors(target, corrected)
        before, difference = patch_colors(target, raw) if raw is not None else ([], None)
        made.append(
            ShownChart(
                frame.name,
                one.type.name,
                _css(one.type.srgb),
                before,
                after,
                difference,
                after_difference,
            )
        )
    return tuple(made)


def patch_colors(target: Target, image: NDArray[np.uint8]) -> tuple[list[str], float]:
    """The mean color of each patch of a chart in an image (H, W, 3), after one exposure gain, as
    CSS, and their median CIEDE2000.

    Patches that are not seen are transparent and left out of the median.
    """
    assert target.type is not None
    seen = np.array([patch.any() for patch in target.patches])
    if not seen.any():
        return ["transparent"] * len(seen), float("nan")
    means = np.stack(
        [decode_srgb(image[patch] / 255.0).mean(axis=0) for patch in target.patches if patch.any()]
    )
    truth = decode_srgb(target.type.srgb[seen])
    exposed = means * exposure_gain(means, truth)
    shown = iter(_css(encode_srgb(np.clip(exposed, 0, 1))))
    difference = float(np.median(ciede2000(lab_from_linear(exposed), lab_from_linear(truth))))
    return [next(shown) if patch else "transparent" for patch in seen], difference


def _css(colors: Floats) -> list[str]:
    return [
        "rgb({} {} {})".format(*np.rint(np.clip(color, 0, 1) * 255).astype(int)) for color in colors
    ]


# Differences of the same patch between charts at several ranges, which a correction should
# remove; needs no known colors.

MOST_CLIPPED = 0.1
"""Largest fraction of a patch's pixels that may be clipped: with more, its mean is not that of the
light.
"""


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
