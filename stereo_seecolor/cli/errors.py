"""Exit codes, and known errors as one line on standard error.

Exit codes: 0 all done; 1 a known error; 2 wrong usage; 3 finished, but with named failures; 130
interrupted.
An error that is not known is a defect of this program and keeps its traceback.
"""

import contextlib
import errno
import os
from collections.abc import Callable, Iterator
from typing import Any

import typer

from stereo_seecolor.cli.interrupts import EXIT_INTERRUPTED
from stereo_seecolor.cli.output import write_error, write_out
from stereo_seecolor.errors import OutputError, printable
from stereo_seecolor.files.json_values import json_line

KNOWN = {"stereo_seecolor.errors.SeeColorError", "calibration.errors.CalibrationError"}
OF_THE_MACHINE = (errno.ENOSPC, errno.EROFS, errno.EMFILE, errno.ENFILE, errno.EIO, errno.ENOMEM)
"""Errors of the system that are not a defect of this program, whatever file they are of."""
EXIT_DONE, EXIT_KNOWN_ERROR, EXIT_USAGE, EXIT_SOME_FAILED = 0, 1, 2, 3


def exit_code_of(command_line: Callable[[], Any], as_json: bool) -> int:
    """Run the command line and return its exit code. as_json: also print errors as JSON."""
    try:
        code = command_line()
        return code if isinstance(code, int) else EXIT_DONE
    except (KeyboardInterrupt, typer.Abort):
        return _fail("interrupted", EXIT_INTERRUPTED, as_json)
    except BrokenPipeError:
        # the reader of the output has gone, as head does when it has seen enough
        return EXIT_KNOWN_ERROR
    except Exception as error:
        if _is_usage_error(error):
            message = _usage_message(error)
            return _fail(message, EXIT_USAGE, as_json) if message else EXIT_USAGE
        if not is_known(error):
            raise
        return _fail(message_of(error), EXIT_KNOWN_ERROR, as_json)


def is_known(error: Exception) -> bool:
    """True for errors whose message suffices for a user: this program's own, by name (two copies of
    a module have two classes), and those of the system that name a file, or say that there is no
    room.
    """
    if isinstance(error, OSError) and (error.filename or error.errno in OF_THE_MACHINE):
        return True
    return not KNOWN.isdisjoint(_names(error))


def _names(error: Exception) -> Iterator[str]:
    return (f"{base.__module__}.{base.__qualname__}" for base in type(error).__mro__)


def message_of(error: Exception) -> str:
    """The message as one line. Readers name most files themselves; what they did not foresee is
    named here: a folder that may not be searched, a name that is too long.
    """
    if isinstance(error, OSError) and KNOWN.isdisjoint(_names(error)):
        place = (
            f"{os.fsdecode(error.filename)}: "
            if isinstance(error.filename, str | bytes | os.PathLike)
            else ""
        )
        return printable(f"{place}{error.strerror or error}")
    return str(error)


def _fail(message: str, code: int, as_json: bool) -> int:
    write_error(f"stereo-seecolor: {message}\n")
    if as_json:
        with contextlib.suppress(OutputError, BrokenPipeError):
            write_out(json_line({"error": message, "exit_code": code}))
    return code


def _is_usage_error(error: Exception) -> bool:
    """True for errors of typer's parser; older versions of typer derive them from click's own."""
    return hasattr(error, "format_message") and getattr(error, "exit_code", None) == EXIT_USAGE


def _usage_message(error: Any) -> str:
    """One line; empty where the program was started without a command and prints its help."""
    if not error.format_message():
        return ""
    context = getattr(error, "ctx", None)
    path = context.command_path if context else "stereo-seecolor"
    message = " ".join(error.format_message().split()).rstrip(".").removeprefix("Invalid value: ")
    return f"{message}: see {path} --help"
