"""The log of a command: the only place that configures logging."""

import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from stereo_seecolor.cli.output import write_error
from stereo_seecolor.errors import OutputError, printable, printable_lines
from stereo_seecolor.files.names import FORM, is_log

LIBRARIES = ("stereo_seecolor", "calibration")


class _Formatter(logging.Formatter):
    """Writes no control character of a file's name or content: a terminal would obey it."""

    def format(self, record: logging.LogRecord) -> str:
        return printable_lines(super().format(record))


class _LogFile(logging.FileHandler):
    """A log whose disk may be full: the first failure is named, once, and the command works on."""

    def __init__(self, path: Path, unwritten: list[str]) -> None:
        super().__init__(path, mode="a", encoding="utf-8", errors="backslashreplace")
        self.path, self.unwritten = path, unwritten

    def emit(self, record: logging.LogRecord) -> None:
        if not self.unwritten:
            super().emit(record)

    def handleError(self, record: logging.LogRecord) -> None:
        if isinstance(error := sys.exc_info()[1], OSError):
            self._say(error)
        else:
            super().handleError(record)

    def close(self) -> None:
        try:
            super().close()
        except OSError as error:  # of the line that is still in its buffer
            self._say(error)

    def _say(self, error: OSError) -> None:
        if not self.unwritten:
            self.unwritten.append(str(self.path))
            why = error.strerror or error
            write_error(
                printable(f"stereo-seecolor: --log-file {self.path}: ends here: {why}") + "\n"
            )


@contextmanager
def logging_to(
    log_file: Path | None, verbose: bool, unwritten: list[str] | None = None
) -> Iterator[None]:
    """Append the log to a file; with verbose, write it to standard error too. Does nothing if
    neither is asked for. unwritten: gets the name of a file that could not be written to its end.

    Raises OutputError if the file cannot be opened, or is there already and no log of this program.
    """
    # or logging itself writes warnings and errors to standard error
    handlers: list[logging.Handler] = [logging.NullHandler()]
    if verbose:
        handlers.append(logging.StreamHandler(sys.stderr))
    if log_file is not None:
        handlers.append(_file_handler(log_file, [] if unwritten is None else unwritten))
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


def _file_handler(path: Path, unwritten: list[str]) -> logging.Handler:
    try:
        if path.is_fifo():
            raise OutputError(f"--log-file {path}: is a named pipe: give another file")
        if path.is_file() and path.stat().st_size and not is_log(path):
            raise OutputError(
                f"--log-file {path}: already exists, and is not a log of this program: give "
                "another name"
            )
        path.parent.mkdir(parents=True, exist_ok=True)
        return _LogFile(path, unwritten)
    except OSError as error:
        raise OutputError(
            f"--log-file {path}: cannot be written: {error.strerror or error}: give another file"
        ) from error
