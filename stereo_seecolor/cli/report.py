"""The output of a command: progress and log while it works, and its result at the end."""

import logging
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NoReturn

import typer

from stereo_seecolor.cli.errors import EXIT_DONE, EXIT_SOME_FAILED, is_known, message_of
from stereo_seecolor.cli.options import REPORTING, AsJson, flag, option
from stereo_seecolor.cli.output import write_error, write_out
from stereo_seecolor.errors import ClusterError, OutputError, printable, printable_lines
from stereo_seecolor.files.json_values import json_line
from stereo_seecolor.files.names import FORM, is_log
from stereo_seecolor.plugins import added, load

if TYPE_CHECKING:
    from stereo_seecolor.compute.interface import Compute
    from stereo_seecolor.progress import Listener


# The log of a command: the only place that configures logging.

LIBRARIES = ("stereo_seecolor", "calibration")


class _Formatter(logging.Formatter):
    """Writes no control character of a file's name or content: a terminal would obey it."""

    def format(self, record: logging.LogRecord) -> str:
        return printable_lines(super().format(record))


class _LogFile(logging.FileHandler):
    """A log whose disk may be full: the first line that cannot be written is named, once, and the
    command works on.
    """

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


ProgressKind = Literal["auto", "bar", "lines", "json", "none"]

log = logging.getLogger("stereo_seecolor.cli")


@contextmanager
def computing(cluster: str, notice: Callable[[str], None]) -> "Iterator[Compute | None]":
    """The cluster of --cluster, while a command works; None for "". notice: called with a line on
    what is waited for.

    Raises ClusterError where it cannot be reached.
    """
    if not cluster:
        yield None
        return
    kind = cluster.partition(":")[0]
    if kind not in added("executors"):
        raise ClusterError(
            f"--cluster {cluster}: is not a cluster: give one of {', '.join(added('executors'))} "
            "(docs/fleets.md)"
        )
    with load("executors", kind, needs=("__call__",))(cluster, notice) as compute:
        yield compute


@dataclass(frozen=True)
class Report:
    """The options of the panel Reporting for one command, and the output that follows from them."""

    command: str
    as_json: AsJson = False
    progress: Annotated[
        ProgressKind,
        option(
            "--progress",
            None,
            "Progress on standard error. auto: a bar on a terminal, elsewhere JSON lines with "
            "--json and plain lines without.",
            REPORTING,
        ),
    ] = "auto"
    verbose: Annotated[
        bool,
        flag(
            "--verbose", "Write the log to standard error, debugging messages included.", REPORTING
        ),
    ] = False
    log_file: Annotated[
        Path | None, option("--log-file", "FILE", "Append the log to this file.", REPORTING)
    ] = None
    unwritten: list[str] = field(default_factory=list, init=False)

    @contextmanager
    def working(self) -> "Iterator[Listener]":
        """Write the log while the command works; yields the listener that shows progress."""
        from stereo_seecolor.progress import LoggingListener

        with logging_to(self.log_file, self.verbose, self.unwritten), self._shown() as listener:
            log.info("command line: %s", " ".join(sys.argv))
            try:
                yield LoggingListener(listener)
            except KeyboardInterrupt:
                log.warning("%s: interrupted", self.command)
                raise
            except Exception as error:
                log.error(
                    "%s failed: %s",
                    self.command,
                    message_of(error),
                    exc_info=self.verbose or not is_known(error),
                )
                raise
            log.info("%s ended", self.command)

    def notice(self, line: str) -> None:
        """Write a line to standard error, in the form of the progress, and to the log."""
        log.info(line)
        kind = self._kind()
        if kind != "none":
            write_error(
                json_line({"event": "notice", "text": line}) if kind == "json" else f"{line}\n"
            )

    def say(self, text: str) -> None:
        """Print a part of the result at once; JSON is one object, printed at the end."""
        if not self.as_json:
            write_out(text)

    def end(self, content: Mapping[str, Any], text: str, exit_code: int = EXIT_DONE) -> NoReturn:
        """Print the result, as JSON with --json, and end the command. The exit code says so if the
        log was not written to its end.
        """
        exit_code = exit_code or (EXIT_SOME_FAILED if self.unwritten else EXIT_DONE)
        write_out(
            json_line({"command": self.command, "exit_code": exit_code, **content})
            if self.as_json
            else text
        )
        raise typer.Exit(exit_code)

    @contextmanager
    def _shown(self) -> "Iterator[Listener]":
        from stereo_seecolor.cli.progress import JsonLines, PlainLines
        from stereo_seecolor.progress import Silence

        kind = self._kind()
        if kind == "bar":
            from stereo_seecolor.cli.progress import bar

            with bar() as listener:
                yield listener
        else:
            yield JsonLines() if kind == "json" else PlainLines() if kind == "lines" else Silence()

    def _kind(self) -> str:
        if self.progress != "auto":
            return self.progress
        if self.verbose:
            return "none"  # the log says it
        if sys.stderr.isatty():
            return "bar"
        return "json" if self.as_json else "lines"


@dataclass(frozen=True)
class LoggedReport(Report):
    """The output of a command that shows no progress."""

    progress: ProgressKind = field(default="none", init=False)


@dataclass(frozen=True)
class BareReport(Report):
    """The output of a command that has no option of the panel but ``--json``."""

    progress: ProgressKind = field(default="auto", init=False)
    verbose: bool = field(default=False, init=False)
    log_file: Path | None = field(default=None, init=False)
