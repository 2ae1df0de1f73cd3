"""The record that describes an export format, and numbers as formats of text hold them."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from stereo_seecolor.run_folder.posed_run import PosedRun


@dataclass(frozen=True)
class ExportFormat:
    """An export format.

    Attributes:
        what: what is written.
        opens: the programs it is for.
        write: writes a fused run into a new folder, and returns a note for the user, or None.
    """

    what: str
    opens: str
    write: Callable[[PosedRun, Path], str | None]


def join_numbers(numbers: Iterable[float], digits: int = 12) -> str:
    """Numbers with that many significant digits, in a line."""
    return " ".join(f"{number:.{digits}g}" for number in numbers)
