"""Sets how often Python collects cyclic garbage, for a process that loads many modules and works on images."""

import atexit
import gc
import sys

NEW_OBJECTS, ROUNDS = 50_000, 10
"""New containers before the youngest generation is collected, 700 by default; and collections before older generations are. Images
are freed at once by reference counting; only small objects in cycles wait for a collection."""


def collect_seldom() -> None:
    """Collect garbage after many more new objects, and not when the process ends, which would take a third of a second."""
    gc.set_threshold(NEW_OBJECTS, ROUNDS, ROUNDS)
    atexit.unregister(_end)
    atexit.register(_end)


def _end() -> None:
    if "open3d" not in sys.modules:  # it prints warnings on its own remaining objects
        gc.freeze()
