"""The outcome of a run and of a fusion, as text."""

from pathlib import Path
from typing import TYPE_CHECKING

from calibration.errors import counted
from stereo_seecolor.cli.text import duration, lines, table
from stereo_seecolor.run_folder.layout import MAP_FILES

if TYPE_CHECKING:
    from stereo_seecolor.mapping.survey_map import MapSummary
    from stereo_seecolor.report.page import PageSummary
    from stereo_seecolor.run_folder.cache import Compared
    from stereo_seecolor.run_folder.frame_table import ProductSummary, RunSummary


MOST_NAMED = 20
"""Files without a partner, and pairs left over, that are named; frames.csv names all."""


def run_text(summary: "RunSummary", out: Path) -> str:
    """The outcome of a run: what was not tried, notes, kinds of errors with numbers, totals,
    results. Progress has named each failed pair.
    """
    from stereo_seecolor.color.white_point import DOUBT  # loads numpy

    bad = [row.line for row in summary.rows if row.status not in ("ok", "failed")]
    named = bad[:MOST_NAMED]
    if len(bad) > MOST_NAMED:
        named.append(f"and {len(bad) - MOST_NAMED} more, named in {out / 'frames.csv'}")
    found = summary.problems()
    doubts = [what for what, *_ in found if what.startswith(DOUBT)][:1]  # of the dive, not a frame
    notes = [f"note: {note}" for note in (*summary.notes, *doubts)]
    problems = [
        (str(often), first, what) for what, often, first in found if not what.startswith(DOUBT)
    ]
    made = [_product_line(product) for product in summary.products]
    return (
        lines(*named, *notes)
        + (table(("times", "first in", "what went wrong"), problems) if problems else "")
        + lines(_totals(summary), *made)
        + (_plan_text(summary.plan) if summary.plan else "")
    )


def _plan_text(compared: "Compared") -> str:
    """A table of the planned and the measured cost."""
    planned, measured = compared.planned, compared.measured
    rows = [
        ("core-hours", f"{planned.core_hours:.3g}", f"{measured.core_hours:.3g}"),
        (
            f"time on {compared.cores} cores",
            duration(3600 * planned.wall_hours),
            duration(3600 * measured.wall_hours),
        ),
        ("disk, GB", f"{planned.disk_bytes / 1e9:.3g}", f"{measured.disk_bytes / 1e9:.3g}"),
        (
            "memory of a process, GB",
            f"{planned.memory_bytes / 1e9:.2g}",
            f"{measured.memory_bytes / 1e9:.2g}",
        ),
    ]
    return table(("against its plan", "planned", "it took"), rows)


def _product_line(product: "ProductSummary") -> str:
    source = "" if product.source == "written" else f" ({product.source})"
    return f"  {product.path}: {product.what}{source}"


def _totals(summary: "RunSummary") -> str:
    # after a stop, some are measured but not yet corrected
    of_them = " of them" if summary.kept <= summary.count("ok") else ""
    kept = f", {summary.kept}{of_them} kept from an earlier run" if summary.kept else ""
    slowest = next(iter(summary.stage_seconds().items()), None)
    slow = f"; the slowest stage was {slowest[0]} ({slowest[1]:.1f} s of work)" if slowest else ""
    done = (
        f"{'stopped early: ' if summary.stopped else ''}{counted(summary.count('ok'), 'pair')} "
        f"done{kept}"
    )
    return (
        f"{done}, {summary.count('failed')} failed, "
        f"{counted(summary.count('unpaired'), 'file without a partner')}, in "
        f"{summary.wall_seconds:.1f} s{slow}"
    )


def page_text(page: Path) -> str:
    """A line that names the page."""
    return lines(f"{page}: the page of the dive; open it in a browser")


def report_text(result: "PageSummary") -> str:
    """The outcome of a page: frames that it does not show, totals, and the page."""
    left_out = [f"not shown: {name}: {reason}" for name, reason in result.left_out.items()]
    totals = (
        f"{counted(result.made + result.kept, 'frame')} shown, {result.kept} of them kept "
        "from an earlier page"
    )
    return lines(*left_out, totals) + page_text(result.page)


def map_text(made: "MapSummary") -> str:
    """The outcome of a fusion: frames that are not in the map, warnings, totals, files."""
    return lines(
        *(f"not placed: {frame.name}: {frame.reason}" for frame in made.unplaced),
        *(f"warning: {warning}" for warning in made.warnings),
        *(str(check) for check in (made.navigation, made.markers) if check),
        f"{made.placed} of {made.frames} frames fused into {made.points} points, in "
        f"{made.seconds:.1f} s",
        *(f"  {file}: {MAP_FILES[file.name]}" for file in made.files),
    )
