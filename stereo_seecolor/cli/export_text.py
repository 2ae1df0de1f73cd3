"""Exports as text for a person."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

from calibration.wording import counted
from stereo_seecolor.cli.console import lines

if TYPE_CHECKING:
    from stereo_seecolor.commands.export import ExportResult
    from stereo_seecolor.export.formats import ExportFormat


def export_text(result: "ExportResult") -> str:
    """What was written, and where."""
    size = f"{counted(result.frames, 'frame')}, {counted(result.files, 'file')}, {result.bytes / 1e6:.1f} MB"
    return lines([size, *([result.note] if result.note else []), f"  {result.folder}: {result.format}"])


def formats_text(formats: Mapping[str, "ExportFormat"]) -> str:
    """Every format, what it holds and what opens it."""
    return lines([f"{name:<12} {format.what}: {format.opens}" for name, format in formats.items()])
