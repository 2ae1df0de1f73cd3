"""The memory that is free for work."""

from contextlib import suppress
from pathlib import Path

USED_FRACTION = 0.75
"""Fraction of the free memory that work is planned into: estimates are for typical images, and other programs use memory, too."""
_MEMINFO, _GROUPS = Path("/proc/meminfo"), Path("/sys/fs/cgroup")
_LIMITS = ("memory.max", "memory/memory.limit_in_bytes")
"""Files of the memory limit of a container or a batch job, in the two versions of Linux's control groups."""


def at_once(most: int, bytes_each: float) -> int:
    """How many of ``most`` pieces of work fit into the free memory, at least 1; ``most`` where free memory is unknown."""
    free = free_bytes()
    return most if free is None else max(1, min(most, int(USED_FRACTION * free / bytes_each)))


def free_bytes() -> int | None:
    """Free memory without swapping, of the machine or of this container if that has less; None where it is not known."""
    known = [_available(), *(_limit(_GROUPS / name) for name in _LIMITS)]
    return min((size for size in known if size is not None), default=None)


def _available() -> int | None:
    with suppress(OSError, ValueError, IndexError):
        for line in _MEMINFO.read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return 1024 * int(line.split()[1])
    return None


def _limit(file: Path) -> int | None:
    with suppress(OSError, ValueError):  # "max" where there is none
        return int(file.read_text())
    return None
