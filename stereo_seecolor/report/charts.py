"""Color charts in the frames of a run: their patches before and after correction, held against the published colors."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration import CalibrationError
from stereo_seecolor.compute.threads import Threads, cores
from stereo_seecolor.errors import InputError
from stereo_seecolor.evaluation.chart_finder import find_charts
from stereo_seecolor.evaluation.measures import ciede2000, exposure_gain, lab_from_linear
from stereo_seecolor.evaluation.spread import SpreadReport
from stereo_seecolor.evaluation.targets import Target, chart
from stereo_seecolor.files.decode import eight_bit
from stereo_seecolor.files.json_values import plain
from stereo_seecolor.files.srgb import decode_srgb, encode_srgb
from stereo_seecolor.report.frame_files import FrameFiles
from stereo_seecolor.run_folder.finished_run import FinishedFrame
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.layout import PAGE

FILE = f"{PAGE}/charts.json"
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class SeenChart:
    """A chart in a frame. published, before, after: colors of its patches as CSS writes them, after one exposure gain.

    before_ciede2000, after_ciede2000: median over patches, None where the image from before is gone.
    """

    frame: str
    kind: str
    published: list[str]
    before: list[str]
    after: list[str]
    before_ciede2000: float | None
    after_ciede2000: float


def find_all(files: FrameFiles, frames: Sequence[FinishedFrame]) -> Iterator[tuple[SeenChart, ...]]:
    """The charts of each frame; takes some five seconds of processor time a frame, all cores together."""

    def of(frame: FinishedFrame) -> tuple[SeenChart, ...]:
        try:
            return _seen(files, frame)
        except InputError:
            return ()

    yield from Threads(cores()).each(of, frames)


def _seen(files: FrameFiles, frame: FinishedFrame) -> tuple[SeenChart, ...]:
    corrected = eight_bit(frame.read("corrected"))
    found = find_charts(corrected)
    try:
        raw = eight_bit(files.raw(frame)) if found else None
    except (InputError, CalibrationError):
        raw = None
    made = []
    for one in found:
        target = chart("chart", one.corners, corrected.shape[:2], one.type)
        after, after_difference = _patches(target, corrected, one.type.srgb)
        before, difference = _patches(target, raw, one.type.srgb) if raw is not None else ([], None)
        made.append(SeenChart(frame.name, one.type.name, _css(one.type.srgb), before, after, difference, after_difference))
    return tuple(made)


def _patches(target: Target, image: NDArray[np.uint8], srgb: Floats) -> tuple[list[str], float]:
    """The mean color of each patch after one exposure gain, and the median CIEDE2000."""
    means = np.stack([decode_srgb(image[patch] / 255.0).mean(axis=0) if patch.any() else np.zeros(3) for patch in target.patches])
    truth = decode_srgb(srgb)
    exposed = means * exposure_gain(means, truth)
    return _css(encode_srgb(np.clip(exposed, 0, 1))), float(np.median(ciede2000(lab_from_linear(exposed), lab_from_linear(truth))))


def _css(colors: Floats) -> list[str]:
    return ["rgb({} {} {})".format(*np.rint(np.clip(color, 0, 1) * 255).astype(int)) for color in colors]


def write_charts(folder: RunFolder, charts: Sequence[SeenChart], spread: SpreadReport | None) -> None:
    """Keep what was found for this page and later ones of the same corrected frames. Raises OutputError."""
    content = plain({"charts": charts, "spread": spread})
    folder.write(FILE, json.dumps(content).encode(), made_from=folder.digest("corrected"))


def kept_charts(folder: RunFolder) -> dict[str, Any]:
    """What ``write_charts`` kept, if it is of the frames as they are now."""
    path = folder.root / FILE
    if not path.is_file() or folder.dive.made_from.get(FILE) != folder.digest("corrected"):
        return {}
    content: dict[str, Any] = json.loads(path.read_bytes())
    return content
