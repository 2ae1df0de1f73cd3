"""The log of a command: the only place that configures logging."""

import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from stereo_seecolor.errors import OutputError, printable_lines
from stereo_seecolor.files.log_form import FORM, is_log

LIBRARIES = ("stereo_seecolor", "calibration")


class _Formatter(logging.Formatter):
    """Writes no control character of a file's name or content: a terminal would obey it."""

    def format(self, record: logging.LogRecord) -> str:
        return printable_lines(super().format(record))


@contextmanager
def logging_to(log_file: Path | None, verbose: bool) -> Iterator[None]:
    """Append the log to a file; with verbose, write it to standard error too. Does nothing if neither is asked for.

    Raises OutputError if the file cannot be opened, or is there already and no log of this program.
    """
    handlers: list[logging.Handler] = [logging.NullHandler()]  # or logging itself writes warnings and errors to standard error
    if verbose:
        handlers.append(logging.StreamHandler(sys.stderr))
    if log_file is not None:
        handlers.append(_file_handler(log_file))
    loggers = [logging.getLogger(name) for name in LIBRARIES]
    for handler in handlers:
        handler.setFormatter(_Formatter(FORM))
        for logger in loggers:
            logger.addHandler(handler)
            logger.setLevel(logging.DEBUG if verbose else logging.INFO)
    try:
        yield
    finally:
        for handler in handlers:
            for logger in loggers:
                logger.removeHandler(handler)
                logger.setLevel(logging.NOTSET)
            handler.close()


def _file_handler(path: Path) -> logging.Handler:
    try:
        if path.is_file() and path.stat().st_size and not is_log(path):
            raise OutputError(f"--log-file {path}: is there already, and is not a log of this program: give another name")
        path.parent.mkdir(parents=True, exist_ok=True)
        return logging.FileHandler(path, mode="a", encoding="utf-8", errors="backslashreplace")
    except OSError as error:
        raise OutputError(f"--log-file {path}: cannot be written: {error.strerror or error}: give another file") from error
