"""How often Python looks for garbage that refers to itself: set once, by a process that loads many modules and works on images."""

import atexit
import gc
import sys

NEW_OBJECTS, ROUNDS = 50_000, 10
"""Containers made before the young ones are examined, 700 by default; and rounds before older ones are. Images are freed at once
by their count of references; what waits for a round are small objects, and errors with what they were raised from."""


def collect_seldom() -> None:
    """Look for garbage after many more new objects, and not when the process ends, which would take a third of a second."""
    gc.set_threshold(NEW_OBJECTS, ROUNDS, ROUNDS)
    atexit.unregister(_end)
    atexit.register(_end)


def _end() -> None:
    if "open3d" not in sys.modules:  # it complains on the terminal of what is left of its own
        gc.freeze()
