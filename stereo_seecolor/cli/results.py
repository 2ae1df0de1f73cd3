"""The JSON content of results for --json (docs/json.md), and their exit codes."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from stereo_seecolor.cli.errors import EXIT_DONE, EXIT_SOME_FAILED
from stereo_seecolor.cli.interrupts import EXIT_INTERRUPTED

if TYPE_CHECKING:
    from stereo_seecolor.commands.calibrate import CalibrationResult
    from stereo_seecolor.commands.check import CheckResult
    from stereo_seecolor.mapping.survey_map import MapSummary
    from stereo_seecolor.run_folder.frame_table import RunSummary


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
    """The exit code of a map."""
    return EXIT_SOME_FAILED if made.problems else EXIT_DONE


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
        "change": report.change.text if report.change else None,
        "views": report.views,
    }


def check_content(result: "CheckResult") -> Content:
    """The content of a calibration tested on a dive."""
    rows, refined = result.rows, result.refined
    return {
        "rig": result.rig,
        "suspicions": result.suspicions,
        "notes": result.images.notes,
        "rows": rows,
        "acceptable": result.acceptable,
        "advice": rows.advice,
        "refined": refined
        and {
            "file": result.refined_file,
            "vertical_disparity_px": refined.before_px,
            "vertical_disparity_refined_px": refined.after_px,
            "movements": refined.movements,
        },
    }
