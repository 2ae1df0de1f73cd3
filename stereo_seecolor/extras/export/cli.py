"""The command export."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calibration.errors import counted
from stereo_seecolor.cli import options as opt
from stereo_seecolor.cli.command import command
from stereo_seecolor.cli.report import BareReport
from stereo_seecolor.cli.text import lines

if TYPE_CHECKING:
    from stereo_seecolor.extras.export.command import ExportResult


@command("Other programs", "export --list", "export OUT --to colmap --out COLMAP")
def export(
    out: Annotated[
        Path | None, typer.Argument(metavar="OUT", help="Output folder of a fused run.")
    ] = None,
    to: Annotated[str, opt.option("--to", "FORMAT", "Format to write, one of --list.")] = "",
    folder: Annotated[
        Path | None, opt.option("--out", "FOLDER", "A new or empty output folder.")
    ] = None,
    listed: Annotated[
        bool, opt.flag("--list", "List the formats, and the programs that open them.")
    ] = False,
    *,
    report: BareReport,
) -> None:
    """Write a fused run for another program: COLMAP, Nerfstudio, Metashape, GLB, TagLab and
    others.
    """
    from stereo_seecolor.extras.export.command import export as write
    from stereo_seecolor.extras.export.command import export_formats

    if listed:
        known = export_formats()
        report.end(
            {"formats": {name: format.opens for name, format in known.items()}},
            lines(*(f"{name:<12} {format.what}: {format.opens}" for name, format in known.items())),
        )
    if out is None or folder is None or not to:
        raise typer.BadParameter("give OUT, --to FORMAT and --out FOLDER, or --list")
    with report.working():
        written = write(out, to, folder)
    report.end({"out": out, **vars(written)}, export_text(written), runs=[out])


def export_text(result: "ExportResult") -> str:
    """The number and size of exported files, and their folder."""
    size = (
        f"{counted(result.frames, 'frame')}, {counted(result.files, 'file')}, "
        f"{result.bytes / 1e6:.1f} MB"
    )
    return lines(
        size, *([result.note] if result.note else []), f"  {result.folder}: {result.format}"
    )
