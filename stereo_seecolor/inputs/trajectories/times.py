"""Times of day and of the epoch, as tables of navigation write them."""

import math
import re
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from itertools import pairwise

_EPOCH_UNITS = ((1e17, 1e9), (1e14, 1e6), (1e11, 1e3))
"""Numbers from here on are in ns, us, ms: as seconds they would be past the year 5000."""
_MOMENT = re.compile(
    r"(\d{1,4})([/.: -])(\d{1,2})[/.: -](\d{1,4})[ ,T]+"
    r"(\d{1,2}):(\d{1,2})(?::(\d{1,2}(?:[.,]\d+)?))?\s*+([AP])?\.?(?:M\.?)?\s*+(?:Z|UTC|GMT)?",
    re.IGNORECASE,
)
_COMPACT = re.compile(r"((?:19|20)\d\d)(\d\d)(\d\d)[ _T-]?(\d\d)(\d\d)(\d\d(?:\.\d*)?)Z?")
"""``20260528_120000``."""
_PARTS = re.compile(r"(\d{4}) (\d{1,2}) (\d{1,2}) (\d{1,2}) (\d{1,2}) (\d{1,2}(?:\.\d*)?)")
"""Columns of year to second."""
_CLOCK_PARTS = re.compile(r"(\d{9,10}) (\d{1,9})")
"""Columns of seconds and nanoseconds."""
_DAY_OF_YEAR = re.compile(r"(\d{4})[-/: ](\d{3})[ T:/]+(\d{1,2}:\d{2}:\d{2}(?:\.\d*)?)")
_WEEKDAY = re.compile(r"^(mon|tue|wed|thu|fri|sat|sun)[a-z]*,? +", re.IGNORECASE)
_MONTHS = {
    "jan": 1, "feb": 2, "mar": 3, "apr": 4, "may": 5, "jun": 6, "jul": 7, "aug": 8, "sep": 9,
    "oct": 10, "nov": 11, "dec": 12, "mrz": 3, "mai": 5, "okt": 10, "dez": 12,
}  # fmt: skip
_NAMED_MONTH = re.compile(
    r"^(\d{1,2})[- /.]+([A-Za-z]{3})[a-z.]*[-, /]+(\d{4}|\d\d)\b"
    r"|^([A-Za-z]{3})[a-z.]* +(\d{1,2}),? +(\d{4})"
)
"""``28-May-2026``, ``May 28, 2026``."""
_DAYS = ((25569, 30_000, 80_000), (719529, 720_000, 800_000))
"""The day of 1970-01-01 where days are counted as spreadsheets and MATLAB do, and the days of
1982 and later.
"""
MAX_DAYS, MAX_STEP_DAYS = 3.0, 0.01
"""Of a column of such days: a dive is shorter, and has a row every quarter of an hour."""
_UNKNOWN = re.compile(
    r"|[-–—]+(\.-+)?|[.?*]+|#?n\.?/?[ad]\.?|[-+]?inf(inity)?|[-+]?nan(\(\w*\))?|-?1\.#\w+|[<(\[]?(null|nil|none|na|nan)[>)\]]?"
    r"|unknown|invalid|missing|undefined|no[ _-]?(data|value|fix)|not[ _]available|\\n"
    r"|#(null|value|ref|div/0|num|name)[!?]|#+",
    re.IGNORECASE,
)
"""What stands in a cell without a value: ``--.--``, ``N/A``, errors of spreadsheets, and what
programs and databases write.
"""


class AmbiguousDateError(ValueError):
    """Dates of a column that may be day/month or month/day."""


class TimeError(ValueError):
    """A cell that is not a time. row: its number in the column, from 0."""

    def __init__(self, row: int, text: str):
        super().__init__(text)
        self.row = row


def is_unknown(text: str) -> bool:
    """Tell whether a cell says that there is no value."""
    return _UNKNOWN.fullmatch(text.strip()) is not None


def seconds(text: str) -> float:
    """Seconds since 1970 from a number (seconds, ms, us or ns, by its size) or an ISO 8601 time;
    UTC unless it says otherwise.

    Raises ValueError for anything else.
    """
    try:
        number = float(text.replace("_", "x"))
    except ValueError:
        moment = datetime.fromisoformat(text.removesuffix(" UTC"))
        return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
    unit = next((unit for least, unit in _EPOCH_UNITS if abs(number) >= least), 1.0)
    return number / unit


def column_seconds(texts: Sequence[str], day_first: bool | None = None) -> list[float]:
    """Seconds since 1970 of a whole column, UTC: as ``seconds``, or a date of three numbers and
    h:m:s, also with AM and PM.

    day_first: whether 3/4/2026 is the third of April where no date of the column tells; None: not
    known. A cell without a value is NaN. Raises AmbiguousDateError where that is needed, and
    TimeError for a cell that is not a time.
    """
    found = [_parsed(row, _plain(text)) for row, text in enumerate(texts)]
    dates = [(int(m[1]), int(m[3])) for m in found if isinstance(m, re.Match) and len(m[1]) < 4]
    if any(first > 12 for first, _ in dates) or any(
        isinstance(m, re.Match) and m[2] == "." for m in found
    ):
        day_first = True
    elif any(second > 12 for _, second in dates):
        day_first = False
    if dates and day_first is None:
        first = next(text for text, m in zip(texts, found, strict=True) if isinstance(m, re.Match))
        raise AmbiguousDateError(f"{first!r} may be day/month or month/day")
    times_s = [
        m if isinstance(m, float) else _of_match(row, m, day_first is not False)
        for row, m in enumerate(found)
    ]
    return _of_days(times_s)


def _of_days(times_s: list[float]) -> list[float]:
    """Times that are counted in days, as spreadsheets and MATLAB do, in seconds."""
    known = [time_s for time_s in times_s if math.isfinite(time_s)]
    steps = [abs(b - a) for a, b in pairwise(known)]
    if not steps or not 0 < max(steps) < MAX_STEP_DAYS or max(known) - min(known) > MAX_DAYS:
        return times_s
    for day, least, most in _DAYS:
        if least < min(known) and max(known) < most:
            return [(time_s - day) * 86400 for time_s in times_s]
    return times_s


def _plain(text: str) -> str:
    """A time of another notation in one that is read: compact, month's name, day of a year."""
    text = _WEEKDAY.sub("", text.strip())
    if match := _COMPACT.fullmatch(text) or _PARTS.fullmatch(text):
        year, month, day, hour, minute, second = match.groups()
        return f"{year}-{month}-{day} {hour}:{minute}:{second}"
    if match := _CLOCK_PARTS.fullmatch(text):
        return f"{match[1]}.{match[2].zfill(9)}"
    if match := _DAY_OF_YEAR.fullmatch(text):
        date = datetime(int(match[1]), 1, 1, tzinfo=UTC) + timedelta(days=int(match[2]) - 1)
        return f"{date:%Y-%m-%d} {match[3]}"
    return _NAMED_MONTH.sub(_with_number_of_month, text)


def _with_number_of_month(match: re.Match[str]) -> str:
    day, month, year = match[1] or match[5], match[2] or match[4], match[3] or match[6]
    number = _MONTHS.get(month.lower())
    return f"{'20' * (len(year) == 2)}{year}-{number}-{day}" if number else match[0]


def _parsed(row: int, text: str) -> float | re.Match[str]:
    if is_unknown(text):
        return float("nan")
    if match := _MOMENT.fullmatch(text.strip()):
        return match
    try:
        return seconds(text.strip())
    except (ValueError, OverflowError) as error:
        raise TimeError(row, text) from error


def _of_match(row: int, match: re.Match[str], day_first: bool) -> float:
    one, two, three, hour, minute = (int(match[i]) for i in (1, 3, 4, 5, 6))
    year, month, day = (
        (one, two, three)
        if len(match[1]) == 4
        else (three, two, one)
        if day_first
        else (three, one, two)
    )
    if half := match[8]:
        hour = hour % 12 + 12 * (half.upper() == "P")
    try:
        midnight = datetime(year + 2000 * (year < 100), month, day, hour, minute, tzinfo=UTC)
    except ValueError as error:
        raise TimeError(row, match[0]) from error
    return midnight.timestamp() + float((match[7] or "0").replace(",", "."))
