"""Heights of a map's terrain for the page: tiles of 16-bit numbers in steps of 0.05 mm."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from stereo_seecolor.errors import InputError
from stereo_seecolor.records import Map
from stereo_seecolor.report.number_code import coded
from stereo_seecolor.run_folder.finished_run import FinishedFrame, FinishedRun


@dataclass(frozen=True)
class HeightCode:
    """Settings of the code."""

    # an error of 0.025 mm; 3.2 m of relief in a tile, and coarser steps where there is more
    step_m: float = 5e-5
    tile_px: int = 512  # as the tiles of the mosaic
    # spread over the dive: the median of their standard errors is steady to a few percent
    sampled_frames: int = 12


HEIGHT_CODE = HeightCode()


def coded_heights(heights_m: Map) -> dict[str, Any]:
    """A tile (H, W) of heights, NaN where unknown, for a script: a height is low_m + (code - 1) *
    step_m, a code of 0 is unknown.
    """
    known = np.isfinite(heights_m)
    low_m, high_m = (
        (float(np.nanmin(heights_m)), float(np.nanmax(heights_m))) if known.any() else (0.0, 0.0)
    )
    step_m = max(HEIGHT_CODE.step_m, (high_m - low_m) / 65535)
    codes = np.where(known, 1 + np.rint((heights_m.astype(np.float64) - low_m) / step_m), 0)
    return {
        "height": heights_m.shape[0],
        "width": heights_m.shape[1],
        "low_m": low_m,
        "step_m": step_m,
        "heights": coded(codes.astype(np.int32)),
    }


def height_tiles(
    width: int, height: int, read: Callable[[tuple[int, int, int, int]], Map]
) -> Iterator[tuple[str, tuple[int, int, int, int], dict[str, Any]]]:
    """(COLUMN_ROW, box, content) of all tiles with a known height. read: box (left, top, width,
    height) -> heights, NaN where unknown.
    """
    size = HEIGHT_CODE.tile_px
    for top in range(0, height, size):
        for left in range(0, width, size):
            box = left, top, min(size, width - left), min(size, height - top)
            heights_m = read(box)
            if np.isfinite(heights_m).any():
                yield f"{left // size}_{top // size}", box, coded_heights(heights_m)


def height_std_m(run: FinishedRun) -> float:
    """The standard error of a height of the map, meters: that of a typical range in one frame.

    Fusing several frames lowers it, and errors of their poses raise it. NaN without frames.
    """
    frames = run.frames[:: max(1, len(run.frames) // HEIGHT_CODE.sampled_frames)]
    known = [
        value for value in (_typical_std_m(run, frame) for frame in frames) if np.isfinite(value)
    ]
    return float(np.median(known)) if known else float("nan")


def _typical_std_m(run: FinishedRun, frame: FinishedFrame) -> float:
    try:
        if "range_std" in frame.products:
            std_m = frame.read("range_std")
        elif run.geometry is not None:
            std_m = run.geometry.estimated_range_std_m(frame.measured_range_m())
        else:
            return float("nan")
    except InputError:
        return float("nan")
    known = std_m[::4, ::4][np.isfinite(std_m[::4, ::4])]
    return float(np.median(known)) if known.size else float("nan")
