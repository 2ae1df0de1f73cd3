"""The record that describes an export format."""

from collections.abc import Callable
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
