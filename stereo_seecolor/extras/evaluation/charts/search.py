"""Color charts in the frames of a run: their patches before and after correction."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from calibration import CalibrationError
from stereo_seecolor.compute.threads import Threads, cores
from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.evaluation.charts.chart_finder import find_charts
from stereo_seecolor.extras.evaluation.charts.targets import Target, found_chart
from stereo_seecolor.extras.evaluation.evaluate_run import evaluate_spread
from stereo_seecolor.extras.evaluation.measures import color_differences, exposure_gain
from stereo_seecolor.files.decode import eight_bit
from stereo_seecolor.files.srgb import decode_srgb, encode_srgb
from stereo_seecolor.progress import Listener
from stereo_seecolor.records import FrameRow
from stereo_seecolor.report.chart_records import ShownChart, write_charts
from stereo_seecolor.report.frame_files import FrameFiles
from stereo_seecolor.run_folder.finished_run import FinishedFrame, FinishedRun
from stereo_seecolor.run_folder.folder import RunFolder

Floats = NDArray[np.float64]


def look_for_charts(folder: RunFolder, run: FinishedRun, listener: Listener) -> None:
    """Search all frames for color charts, compare views of the same spots, and keep both."""
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
    """The charts of each frame, on all cores; two seconds for a frame of 1.4 megapixels."""

    def of(frame: FinishedFrame) -> tuple[ShownChart, ...]:
        try:
            return _seen(files, frame)
        except InputError:
            return ()

    yield from Threads(cores()).each(of, frames)


def _seen(files: FrameFiles, frame: FinishedFrame) -> tuple[ShownChart, ...]:
    """The charts in a frame's corrected image, with their colors before where it is there."""
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
    difference = float(np.median(color_differences(exposed, truth)))
    return [next(shown) if patch else "transparent" for patch in seen], difference


def _css(colors: Floats) -> list[str]:
    return [
        "rgb({} {} {})".format(*np.rint(np.clip(color, 0, 1) * 255).astype(int)) for color in colors
    ]
