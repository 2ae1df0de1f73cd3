"""This process: its memory, garbage, usage, and the threads of libraries."""

import atexit
import ctypes
import gc
import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

# Sets how the C library reuses freed memory, for a process that allocates and frees many images.

TRIM_THRESHOLD, MMAP_THRESHOLD, ARENA_MAX, MMAP_MAX = -1, -3, -8, -4
"""Parameters of mallopt(3)."""
LARGEST_KEPT, MOST_KEPT = 1 << 25, (1 << 31) - 1
"""Bytes, the largest that the GNU C library takes. Larger blocks than 32 MiB come from the memory
it keeps only where none at all (MMAP_MAX) may come from elsewhere: clearing them again was 40 % of
the processor time of images of 21 megapixels.
"""


def tune_malloc() -> None:
    """Keep freed memory for the next image, in one arena for all threads; does nothing without the
    GNU C library.

    By default each thread has an arena, whose end is returned to the system when it is free, and
    must be cleared by the system for the next image.
    """
    if not sys.platform.startswith("linux"):
        return
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        for parameter, value in (
            (ARENA_MAX, 1),
            (MMAP_THRESHOLD, LARGEST_KEPT),
            (TRIM_THRESHOLD, MOST_KEPT),
            (MMAP_MAX, 0),
        ):
            mallopt(parameter, value)


# Sets how often Python collects cyclic garbage, for a process that loads many modules and works
# on images.

NEW_OBJECTS, ROUNDS = 50_000, 10
"""New containers before the youngest generation is collected, 700 by default; and collections
before older generations are. Images are freed at once by reference counting; only small objects in
cycles wait for a collection.
"""


def tune_gc() -> None:
    """Collect garbage after many more new objects, and not when the process ends, which would take
    a third of a second.
    """
    gc.set_threshold(NEW_OBJECTS, ROUNDS, ROUNDS)
    atexit.unregister(_end)
    atexit.register(_end)


def _end() -> None:
    if "open3d" not in sys.modules:  # it prints warnings on its own remaining objects
        gc.freeze()


# The memory that is free for work.

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
    """How many of ``most`` pieces of work fit into the free memory, at least 1; ``most`` where free
    memory is unknown.
    """
    free = free_bytes()
    return most if free is None else max(1, min(most, int(USED_FRACTION * free / bytes_each)))


def free_bytes() -> int | None:
    """Free memory without swapping, of the machine or of this container if that has less left; None
    where it is not known.
    """
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


# Processor time and memory that this process has used.


def core_seconds() -> float:
    """Processor time of this process so far."""
    return time.process_time()


def peak_bytes() -> int:
    """The largest memory that this process has had; 0 where it is not known."""
    if sys.platform == "win32":
        return 0
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak


# Limits the threads of other libraries, in a process that works on many pairs at once.

PRODUCTS = "OPENBLAS_NUM_THREADS"
VARIABLES = {PRODUCTS: "numpy", "OPENCV_FOR_THREADS_NUM": "cv2"}
"""Environment variables, each read once by the library named beside it, when it is imported."""


def one_thread_in_libraries() -> None:
    """Use one thread in OpenCV and in products of matrices, if these libraries are not imported yet
    and the environment sets no other number.

    OpenBLAS starts a thread for each core for matrices of a few dozen rows, and these wait in busy
    loops: solving the light of a dive took three times the processor time. OpenCV's threads cost a
    run 8 %.
    """
    for variable, module in VARIABLES.items():
        if module not in sys.modules:
            os.environ.setdefault(variable, "1")


@contextmanager
def one_thread_in_products() -> Iterator[None]:
    """Use one thread in products of matrices while the block runs, in a program that has imported
    numpy before.
    """
    if PRODUCTS in os.environ:
        yield
        return
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1, user_api="blas"):
        yield
