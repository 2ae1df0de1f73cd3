"""The free memory of this machine or container, and how much work fits into it."""

from contextlib import suppress
from pathlib import Path

USED_FRACTION = 0.75
"""Fraction of the free memory that work is planned into: estimates are for typical images, and
other programs use memory, too.
"""
_MEMINFO, _GROUPS = Path("/proc/meminfo"), Path("/sys/fs/cgroup")
_GROUP_FILES = (
    ("memory.max", "memory.current", "memory.stat", "inactive_file"),
    (
        "memory/memory.limit_in_bytes",
        "memory/memory.usage_in_bytes",
        "memory/memory.stat",
        "total_inactive_file",
    ),
)
"""Files of a container or a batch job in the two versions of Linux's control groups: limit, usage,
and statistics, with the name of what is used for copies of files alone, which can be given back.
"""


def at_once(most: int, bytes_each: float) -> int:
    """How many of ``most`` jobs fit into the free memory, at least 1; ``most`` if unknown."""
    free = free_bytes()
    return most if free is None else max(1, min(most, int(USED_FRACTION * free / bytes_each)))


def free_bytes() -> int | None:
    """Free memory without swapping, of the machine or of this container; None where not known."""
    known = [_available(), *(_left_in_group(*names) for names in _GROUP_FILES)]
    return min((size for size in known if size is not None), default=None)


def _available() -> int | None:
    with suppress(OSError, ValueError, IndexError):
        for line in _MEMINFO.read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return 1024 * int(line.split()[1])
    return None


def _left_in_group(limit: str, usage: str, statistics: str, cached: str) -> int | None:
    """What the group's limit leaves; None where there is no limit."""
    try:
        most = int((_GROUPS / limit).read_text())  # "max" where there is none
    except (OSError, ValueError):
        return None
    used = given_back = 0
    with suppress(OSError, ValueError, IndexError):
        used = int((_GROUPS / usage).read_text())
        for line in (_GROUPS / statistics).read_text().splitlines():
            if line.startswith(f"{cached} "):
                given_back = int(line.split()[1])
    return max(most - max(used - given_back, 0), 0)
