"""Time stamps in file names, as vehicles write them, and distances to the other side's."""

import re
from bisect import bisect_left
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from pathlib import Path

_SECONDS_NANOSECONDS = re.compile(
    r"(?<!\d)(\d{10})[-_.](\d{6,10})(?!\d)|(?<!\d)(1\d{9})\.(\d{1,5})(?!\d)"
)
_EPOCH = re.compile(r"(?<!\d)(\d{19}|1[0-7]\d{15}|\d{16}|\d{13})(?!\d)")
_CALENDAR = re.compile(
    r"(?<!\d)(\d{4})-?(\d\d)-?(\d\d)[T_ "
    r".-]?(\d\d)[-:_.]?(\d\d)[-:_.]?(\d\d)(?:[._-]?(\d{1,9}))?(?!\d)"
)
_EPOCH_UNITS = {19: 1e9, 17: 1e7, 16: 1e6, 13: 1e3}


def timestamp_from_name(stem: str) -> float | None:
    """Seconds since 1970 from a file name's stem, None where it holds no time.

    Understood: seconds and fraction (``1317354879.544786``, ``1659471354-0395682455``,
    ``1317354879.54``), epoch in ns, 0.1 us, us or ms by its number of digits, and calendar time in
    UTC (``20180811_153729_762``, ``2022-08-01T12-34-56.250``).
    """
    if match := _SECONDS_NANOSECONDS.search(stem):
        seconds, fraction = (part for part in match.groups() if part is not None)
        # ten digits after a dash are nanoseconds with a leading zero, as ROS bags' extractors write
        # them
        return int(seconds) + (
            int(fraction) / 1e9 if len(fraction) == 10 else int(fraction) / 10 ** len(fraction)
        )
    if match := _EPOCH.search(stem):
        return int(match[1]) / _EPOCH_UNITS[len(match[1])]
    if match := _CALENDAR.search(stem):
        *calendar, fraction = match.groups()
        try:
            moment = datetime(*(int(part) for part in calendar), tzinfo=UTC)  # type: ignore[misc, arg-type]
        except ValueError:
            return None
        return moment.timestamp() + (int(fraction) / 10 ** len(fraction) if fraction else 0.0)
    return None


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
    """Compute the seconds to the nearest of the others for each path with a time stamp, where that
    is less than FAR_S.
    """
    times = [time_s for time_s, _ in timed(others)]
    found = {
        path: abs(times[i] - time_s)
        for time_s, path in timed(paths)
        if (i := nearest(times, time_s)) is not None
    }
    return {path: off_s for path, off_s in found.items() if off_s < FAR_S}
