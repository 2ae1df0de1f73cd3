"""How the program ends: exit codes, and known errors as one line on standard error.

Exit codes: 0 all done; 1 a known error; 2 wrong usage; 3 finished, but with named failures; 130 interrupted.
An error that is not known is a defect of this program and keeps its traceback.
"""

import contextlib
from collections.abc import Callable
from typing import Any

import typer

from stereo_seecolor.cli.interrupts import EXIT_INTERRUPTED
from stereo_seecolor.cli.streams import write_error, write_out
from stereo_seecolor.errors import OutputError
from stereo_seecolor.files.json_values import json_line

KNOWN = {"stereo_seecolor.errors.SeeColorError", "calibration.errors.CalibrationError"}
EXIT_DONE, EXIT_KNOWN_ERROR, EXIT_USAGE, EXIT_SOME_FAILED = 0, 1, 2, 3


def exit_code_of(command_line: Callable[[], Any], as_json: bool) -> int:
    """Run the command line and return its exit code. as_json: known errors are also printed as a JSON object."""
    try:
        code = command_line()
        return code if isinstance(code, int) else EXIT_DONE
    except (KeyboardInterrupt, typer.Abort):
        return _fail("interrupted", EXIT_INTERRUPTED, as_json)
    except BrokenPipeError:  # the reader of the output has gone, as head does when it has seen enough
        return EXIT_KNOWN_ERROR
    except Exception as error:
        if _is_usage_error(error):
            message = _usage_message(error)
            return _fail(message, EXIT_USAGE, as_json) if message else EXIT_USAGE
        if not is_known(error):
            raise
        return _fail(str(error), EXIT_KNOWN_ERROR, as_json)


def is_known(error: Exception) -> bool:
    """True for this program's own errors, whose message suffices for a user; by name: two copies of a module have two classes."""
    return not KNOWN.isdisjoint(f"{base.__module__}.{base.__qualname__}" for base in type(error).__mro__)


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
    """One line; empty where the program was started without a command, whose help is then printed."""
    if not error.format_message():
        return ""
    context = getattr(error, "ctx", None)
    path = context.command_path if context else "stereo-seecolor"
    message = " ".join(error.format_message().split()).rstrip(".").removeprefix("Invalid value: ")
    return f"{message}: see {path} --help"
