"""The output of a command: progress and log while it works, and its result at the end."""

import logging
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NoReturn

import typer

from stereo_seecolor.cli.errors import EXIT_DONE, EXIT_SOME_FAILED, is_known, message_of
from stereo_seecolor.cli.options import REPORTING, AsJson, flag, option
from stereo_seecolor.cli.output import write_error, write_out
from stereo_seecolor.cli.text import lines
from stereo_seecolor.errors import ClusterError
from stereo_seecolor.files.json_values import json_line
from stereo_seecolor.plugins import added, load

if TYPE_CHECKING:
    from stereo_seecolor.compute.interface import Compute
    from stereo_seecolor.progress import Listener
from stereo_seecolor.cli.log import logging_to

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
                json_line({"event": "notice", "text": line}) if kind == "json" else lines(line)
            )

    def say(self, text: str) -> None:
        """Print a part of the result at once; JSON is one object, printed at the end."""
        if not self.as_json:
            write_out(text)

    def end(
        self,
        content: Mapping[str, Any],
        text: str,
        exit_code: int = EXIT_DONE,
        runs: Sequence[Path] = (),
    ) -> NoReturn:
        """Print the result, as JSON with --json, and end the command. The exit code says so if the
        log was not written to its end, or if a check found numbers of the finished ``runs`` wrong,
        which the result is made of.
        """
        problems = list(_wrong_lines(runs))
        for line in problems:
            log.warning(line)
            write_error(lines(f"note: {line}"))
        exit_code = exit_code or (EXIT_SOME_FAILED if self.unwritten or problems else EXIT_DONE)
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
            from stereo_seecolor.cli.progress_bar import bar

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


def _wrong_lines(runs: Sequence[Path]) -> Iterator[str]:
    """What the checks of finished runs found wrong, and why, of those that did."""
    from stereo_seecolor.run_folder.finished_run import totals_of, wrong_numbers

    for out in runs:
        totals = totals_of(out)
        if what := " and ".join(sorted(wrong_numbers(totals))):
            causes = (n for n in totals["notes"] if n.startswith(("calibration: ", "input: ")))
            yield f"{out}: {what} are wrong: {next(causes, 'see the notes in run.json')}"
