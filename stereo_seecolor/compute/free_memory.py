"""How much memory work can still have."""

from contextlib import suppress
from pathlib import Path

SHARE = 0.75
"""Of the free memory that work is planned into: the estimates are of typical images, and others use the machine, too."""
_MEMINFO, _GROUPS = Path("/proc/meminfo"), Path("/sys/fs/cgroup")
_LIMITS = ("memory.max", "memory/memory.limit_in_bytes")
"""Of a container or a batch job, as the two versions of Linux's control groups call it."""


def at_once(most: int, bytes_each: float) -> int:
    """How many of ``most`` pieces of work fit into the free memory, at least 1; ``most`` where the system does not say."""
    free = free_bytes()
    return most if free is None else max(1, min(most, int(SHARE * free / bytes_each)))


def free_bytes() -> int | None:
    """What can be had without swapping, of the machine and of the container that this runs in; None where that is not known."""
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
