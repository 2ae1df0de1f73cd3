"""Times of day and of the epoch, as tables of navigation write them."""

import re
from collections.abc import Sequence
from datetime import UTC, datetime

_EPOCH_UNITS = ((1e17, 1e9), (1e14, 1e6), (1e11, 1e3))
"""Numbers from here on are in nanoseconds, microseconds, milliseconds: in seconds they would be past the year 5000."""
_MOMENT = re.compile(
    r"(\d{1,4})([/.-])(\d{1,2})[/.-](\d{1,4})[ ,T]+"
    r"(\d{1,2}):(\d{2})(?::(\d{2}(?:[.,]\d+)?))?\s*([AP])?\.?(?:M\.?)?\s*(?:Z|UTC|GMT)?",
    re.IGNORECASE,
)
_UNKNOWN = re.compile(r"|-+(\.-+)?|n/?a|nan|null|nil|none|unknown|invalid", re.IGNORECASE)
"""What stands in a cell without a value, ``--.--`` and ``N/A`` among them."""


class AmbiguousDateError(ValueError):
    """Dates of a column that may be day/month or month/day."""


class TimeError(ValueError):
    """A cell that is no time. row: its number in the column, from 0."""

    def __init__(self, row: int, text: str):
        super().__init__(text)
        self.row = row


def is_unknown(text: str) -> bool:
    """Tell whether a cell says that there is no value."""
    return _UNKNOWN.fullmatch(text.strip()) is not None


def seconds(text: str) -> float:
    """Seconds since 1970 from a number (seconds, ms, us or ns, by its size) or an ISO 8601 time; UTC unless it says otherwise.

    Raises ValueError for anything else.
    """
    try:
        number = float(text)
    except ValueError:
        moment = datetime.fromisoformat(text.removesuffix(" UTC"))
        return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
    unit = next((unit for least, unit in _EPOCH_UNITS if abs(number) >= least), 1.0)
    return number / unit


def column_seconds(texts: Sequence[str], day_first: bool | None = None) -> list[float]:
    """Seconds since 1970 of a whole column, UTC: as ``seconds``, or a date of three numbers and h:m:s, also with AM and PM.

    day_first: whether 3/4/2026 is the third of April where no date of the column tells; None: not known. A cell without a value is
    NaN. Raises AmbiguousDateError where that is needed, and TimeError for a cell that is no time.
    """
    found = [_parsed(row, text) for row, text in enumerate(texts)]
    dates = [(int(m[1]), int(m[3])) for m in found if isinstance(m, re.Match) and len(m[1]) < 4]
    if any(first > 12 for first, _ in dates) or any(isinstance(m, re.Match) and m[2] == "." for m in found):
        day_first = True
    elif any(second > 12 for _, second in dates):
        day_first = False
    if dates and day_first is None:
        first = next(text for text, m in zip(texts, found, strict=True) if isinstance(m, re.Match))
        raise AmbiguousDateError(f"{first!r} may be day/month or month/day")
    return [m if isinstance(m, float) else _of_match(row, m, day_first is not False) for row, m in enumerate(found)]


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
    year, month, day = (one, two, three) if len(match[1]) == 4 else (three, two, one) if day_first else (three, one, two)
    if half := match[8]:
        hour = hour % 12 + 12 * (half.upper() == "P")
    try:
        midnight = datetime(year + 2000 * (year < 100), month, day, hour, minute, tzinfo=UTC)
    except ValueError as error:
        raise TimeError(row, match[0]) from error
    return midnight.timestamp() + float((match[7] or "0").replace(",", "."))
