"""Open the map of a fused run in a window."""

from dataclasses import dataclass
from pathlib import Path

from stereo_seecolor.mapping.viewer import view as open_window


@dataclass(frozen=True)
class ViewResult:
    """The map that was shown."""

    out: Path


def view(out: Path) -> ViewResult:
    """Show the map of ``out`` until its window is closed. Raises InputError without a map, DeviceError without viewer or screen."""
    open_window(out)
    return ViewResult(out)
