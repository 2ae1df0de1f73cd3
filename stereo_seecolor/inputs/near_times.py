"""Time stamps in file names, and the distance to the nearest one of the other side."""

from bisect import bisect_left
from collections.abc import Iterable, Sequence
from pathlib import Path

from stereo_seecolor.inputs.timestamps import timestamp_from_name

FAR_S = 1.0
"""Files farther apart were not meant for each other."""


def timed(paths: Iterable[Path]) -> list[tuple[float, Path]]:
    """List the files with a time stamp, (seconds, path), in order of time."""
    return sorted((t, p) for p in paths if (t := timestamp_from_name(p.stem)) is not None)


def nearest(times: Sequence[float], time_s: float) -> int | None:
    """The index of the nearest of sorted times; None where there are none."""
    right = bisect_left(times, time_s)
    candidates = [i for i in (right - 1, right) if 0 <= i < len(times)]
    return min(candidates, key=lambda i: abs(times[i] - time_s), default=None)


def distances_s(paths: Iterable[Path], others: Iterable[Path]) -> dict[Path, float]:
    """Compute the seconds to the nearest of the others for each path with a time stamp, where that is less than FAR_S."""
    times = [time_s for time_s, _ in timed(others)]
    found = {path: abs(times[i] - time_s) for time_s, path in timed(paths) if (i := nearest(times, time_s)) is not None}
    return {path: off_s for path, off_s in found.items() if off_s < FAR_S}
