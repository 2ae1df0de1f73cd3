"""The command line: the only place that prints, parses and exits."""

import sys

from stereo_seecolor.cli.interrupts import EXIT_INTERRUPTED, interrupts
from stereo_seecolor.compute.library_threads import one_thread_in_libraries
from stereo_seecolor.compute.process import tune_gc, tune_lock

__all__ = ["main"]


def main() -> None:
    """Run the command line and exit with its code. Slow imports come after Ctrl-C is handled."""
    with interrupts():
        try:
            tune_gc()
            tune_lock()
            # before any command is imported, since commands import these libraries
            one_thread_in_libraries()
            from stereo_seecolor.cli.app import run_command_line

            sys.exit(run_command_line())
        except KeyboardInterrupt:
            sys.exit(EXIT_INTERRUPTED)
