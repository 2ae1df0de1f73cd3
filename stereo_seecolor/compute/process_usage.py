"""Processor time and memory that this process has used."""

import sys
import time


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
