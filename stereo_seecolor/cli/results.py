"""Results of commands as JSON and as text, and their exit codes."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from calibration.errors import counted
from stereo_seecolor.cli.errors import EXIT_DONE, EXIT_SOME_FAILED
from stereo_seecolor.cli.interrupts import EXIT_INTERRUPTED
from stereo_seecolor.cli.output import duration, lines, table
from stereo_seecolor.run_folder.layout import MAP_FILES

if TYPE_CHECKING:
    from stereo_seecolor.commands.calibrate import CalibrationResult, CheckResult
    from stereo_seecolor.mapping.survey_map import MapSummary
    from stereo_seecolor.report.page import PageSummary
    from stereo_seecolor.run_folder.cache import Compared
    from stereo_seecolor.run_folder.frames_csv import ProductSummary, RunSummary


# The JSON content of results for --json (docs/json.md), and their exit codes.

Content = dict[str, Any]


def run_content(summary: "RunSummary", out: Path) -> Content:
    """The content of a run: totals, and each pair that failed."""
    return {
        "out": out,
        **summary.totals(),
        "failed_pairs": [row for row in summary.rows if row.status != "ok"],
        "products": [vars(product) for product in summary.products],
    }


def run_exit_code(summary: "RunSummary") -> int:
    """The exit code of a run: interrupted, done, or finished with failures."""
    if summary.stopped:
        return EXIT_INTERRUPTED
    return EXIT_DONE if summary.all_done else EXIT_SOME_FAILED


def map_exit_code(made: "MapSummary") -> int:
    """The exit code of a map. It is not that of success where frames are missing or lie in separate
    pieces, where given poses contradict the images or could not be tested, or where given lengths
    of markers cannot be right.
    """
    contradicted = made.navigation is not None and not (
        made.navigation.fits and made.navigation.relative_poses
    )
    refused = made.markers is not None and made.markers.refused
    apart = len(made.components) > 1
    return EXIT_SOME_FAILED if made.unplaced or apart or contradicted or refused else EXIT_DONE


def calibration_content(result: "CalibrationResult") -> Content:
    """The content of a new calibration: its files and its quality."""
    report = result.report
    return {
        "calibration": result.calibration,
        "coverage_picture": result.coverage,
        "verdict": report.verdict,
        "baseline_m": report.rig.baseline_m,
        "baseline_std_m": float(report.lens.std[2]),
        "focal_std": report.focal_std,
        "rms_left_px": report.rms_left_px,
        "rms_right_px": report.rms_right_px,
        "row_error_px": report.lens.row_error_px,
        "coverage": report.coverage,
        "views": report.views,
    }


def check_content(result: "CheckResult") -> Content:
    """The content of a calibration tested on a dive."""
    rows = result.rows
    return {
        "rig": result.rig,
        "suspicions": result.suspicions,
        "notes": result.images.notes,
        "rows": rows,
        "acceptable": result.acceptable,
        "advice": rows.advice,
        "refined": _refined_content(result),
    }


def _refined_content(result: "CheckResult") -> Content | None:
    if result.refined is None:
        return None
    refined = result.refined
    return {
        "file": result.refined_file,
        "vertical_disparity_px": refined.before_px,
        "vertical_disparity_refined_px": refined.after_px,
        "movements": refined.movements,
    }


# The outcome of a run and of a fusion, as text.

MOST_NAMED = 20
"""Failed pairs that are named on the terminal; frames.csv names all."""


def run_text(summary: "RunSummary", out: Path) -> str:
    """The outcome of a run: failed pairs, notes, kinds of errors with their numbers, totals, and
    results.
    """
    from stereo_seecolor.color.white_point import DOUBT  # loads numpy

    bad = [row.line for row in summary.rows if row.status != "ok"]
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
