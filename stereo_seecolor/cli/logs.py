"""The log of a command: the only place that configures logging."""

import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from stereo_seecolor.errors import OutputError

FORM = "%(asctime)s %(levelname)s %(name)s: %(message)s"
LIBRARIES = ("stereo_seecolor", "calibration")
LOG_SUFFIXES = ("", ".log", ".txt")
"""A file with another suffix that holds something may be a calibration or a track, which lines of a log would spoil."""


@contextmanager
def logging_to(log_file: Path | None, verbose: bool) -> Iterator[None]:
    """Append the log to a file; with verbose, write it to standard error too. Does nothing if neither is asked for.

    Raises OutputError if the file cannot be opened, is no text file, or is there already under a name that no log has.
    """
    handlers: list[logging.Handler] = [logging.NullHandler()]  # or logging itself writes warnings and errors to standard error
    if verbose:
        handlers.append(logging.StreamHandler(sys.stderr))
    if log_file is not None:
        handlers.append(_file_handler(log_file))
    loggers = [logging.getLogger(name) for name in LIBRARIES]
    for handler in handlers:
        handler.setFormatter(logging.Formatter(FORM))
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
        if path.is_file():
            with path.open("rb") as file:
                content = file.read(4096)
            if b"\0" in content:
                raise OutputError(f"--log-file {path}: is not a text file: give another name for the log")
            if content and path.suffix.lower() not in LOG_SUFFIXES:
                raise OutputError(f"--log-file {path}: is there already, and is not named as a log: give a name that ends in .log")
        path.parent.mkdir(parents=True, exist_ok=True)
        return logging.FileHandler(path, mode="a", encoding="utf-8", errors="backslashreplace")
    except OSError as error:
        raise OutputError(f"--log-file {path}: cannot be written: {error.strerror or error}: give another file") from error
