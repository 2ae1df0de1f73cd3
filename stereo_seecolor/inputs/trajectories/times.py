"""Times of day and of the epoch, as tables of navigation write them."""

import re
from datetime import UTC, datetime

_EPOCH_UNITS = ((1e17, 1e9), (1e14, 1e6), (1e11, 1e3))
"""Numbers from here on are in nanoseconds, microseconds, milliseconds: in seconds they would be past the year 5000."""


def seconds(text: str) -> float:
    """Seconds since 1970 from a number (seconds, ms, us or ns, by its size) or an ISO 8601 time; UTC unless it says otherwise.

    Raises ValueError for anything else.
    """
    try:
        number = float(text)
    except ValueError:
        moment = datetime.fromisoformat(text)
        return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
    unit = next((unit for least, unit in _EPOCH_UNITS if abs(number) >= least), 1.0)
    return number / unit


def date_and_time(date: str, time: str) -> float:
    """Seconds since 1970 from d/m/Y or Y/m/d, with slashes or dashes, and h:m:s with a fraction or without, UTC.

    Raises ValueError for anything else.
    """
    parts = re.split(r"[/-]", date)
    if len(parts) != 3 or time.count(":") != 2:
        raise ValueError("write d/m/Y or Y/m/d and h:m:s")
    day, month, year = (int(part) for part in (parts if len(parts[2]) == 4 else parts[::-1]))
    hours, minutes, rest = time.split(":")
    return datetime(year, month, day, tzinfo=UTC).timestamp() + 3600 * int(hours) + 60 * int(minutes) + float(rest)
