"""How this process allocates memory and collects garbage, and the most memory that it has had."""

import atexit
import ctypes
import gc
import sys

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


def return_freed() -> None:
    """Return the memory that ``tune_malloc`` keeps to the system, between stages that have little
    in common; does nothing without the GNU C library.
    """
    if sys.platform.startswith("linux"):
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
        if trim is not None:
            trim(0)


NEW_OBJECTS, ROUNDS = 50_000, 10
"""New containers before the youngest generation is collected, 700 by default; and collections
before older generations are. Images are freed at once by reference counting; only small objects in
cycles wait for a collection.
"""


def tune_gc() -> None:
    """Collect garbage after more new objects, and not at the end, which would take 0.3 s."""
    gc.set_threshold(NEW_OBJECTS, ROUNDS, ROUNDS)
    atexit.unregister(_end)
    atexit.register(_end)


SWITCH_S = 5e-4
"""Seconds that a thread keeps Python's global lock while others wait for it, 5 ms by default: what
threads do between two calls of a library takes far less, and torch is imported beside them.
"""


def tune_lock() -> None:
    """Let threads take turns in Python after a shorter time."""
    sys.setswitchinterval(SWITCH_S)


def _end() -> None:
    if "open3d" not in sys.modules:  # it prints warnings on its own remaining objects
        gc.freeze()


def peak_bytes() -> int:
    """The largest memory that this process has had; 0 where it is not known."""
    if sys.platform == "win32":
        return 0
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak
