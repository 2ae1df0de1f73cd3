"""Scores of a run against truth, of methods on color targets, and of differences between views, as
text.
"""

import shlex
from math import isnan
from typing import TYPE_CHECKING

from calibration.errors import counted
from stereo_seecolor.cli.text import lines, table

if TYPE_CHECKING:
    from stereo_seecolor.extras.evaluation.charts.scores import ChartReport
    from stereo_seecolor.extras.evaluation.spread import SpreadReport
    from stereo_seecolor.extras.evaluation.truth import TruthReport
    from stereo_seecolor.extras.evaluation.water import MeasuredWater


def truth_text(report: "TruthReport") -> str:
    """Errors of a run relative to ground truth: ranges, and colors with those of the raw images."""
    ranges, color, raw = report.range, report.color, report.raw_color
    measures = (
        ("mean angle to the true color, degrees", "angle_deg", ".2f"),
        ("the same after the best gain for each channel", "angle_after_gains_deg", ".2f"),
        ("CIEDE2000, median", "ciede2000", ".2f"),
        ("red/blue, far over near, true = 1", "range_consistency", ".3f"),
        ("pixels clipped", "clipped_fraction", ".2%"),
    )
    return (
        lines(
            f"{len(report.frames)} frames compared with ground truth, means over frames; no "
            f"result for {len(report.missing)} frames",
            f"range: median error {ranges.median_relative_error:.2%} of the range; disparity off "
            f"by over 1 px {ranges.bad_1_px:.2%}, over 2 px {ranges.bad_2_px:.2%}; measured "
            f"{ranges.coverage:.1%} of the pixels that both cameras see",
        )
        + table(
            ("color", "corrected", "raw image"),
            [
                (what, format(getattr(color, name), style), format(getattr(raw, name), style))
                for what, name, style in measures
            ],
        )
        + lines(
            f"over {color.pixels:.0f} pixels a frame: those with a measured range and a true "
            "color neither clipped nor nearly black"
        )
    )


def charts_text(report: "ChartReport") -> str:
    """A table of every method on every target, and the means."""
    columns = (
        "frame",
        "target",
        "method",
        "range m",
        "psi",
        "psi linear",
        "CIEDE2000",
        "clipped",
        "chroma",
    )
    rows = []
    for row in (*report.rows, *report.means()):
        numbers = [
            f"{value:.1f}"
            for value in (row.range_m, row.psi_deg, row.psi_linear_deg, row.ciede2000)
        ]
        rows.append(
            (
                row.frame,
                row.target,
                row.method,
                *numbers,
                f"{row.clipped_fraction:.1%}",
                f"{row.chroma:.0f}",
            )
        )
    without = (
        [f"without a target: {', '.join(report.without_target)}"] if report.without_target else []
    )
    missing = [
        f"{method}: has no image of {', '.join(stems)}: its means leave them out"
        for method, stems in report.missing.items()
    ]
    sheet = f"  {report.sheet}: contact sheet of every method on every frame"
    return table(columns, rows) + _ranges_text(report) + lines(*without, *missing, sheet)


def _ranges_text(report: "ChartReport") -> str:
    """A table of the color difference of patches between ranges; "" if not measured."""
    if not report.spreads:
        return ""
    columns = ("method", "charts", "range m", "patch angle", "patch luminance")
    rows = [
        (
            row.method,
            f"{row.charts} {row.chart}",
            f"{row.nearest_m:.1f}..{row.farthest_m:.1f}",
            f"{row.angle_deg:.1f}",
            f"{row.luminance:.2f}",
        )
        for row in report.spreads
    ]
    return lines(
        "the same patch on charts at several ranges: mean angle, and spread of the logarithm of "
        "luminance"
    ) + table(columns, rows)


def spread_text(report: "SpreadReport") -> str:
    """A table of the differences of the same spots between frames."""
    measures = (
        ("brightness of one spot between views, robust spread", "luminance", ".3f"),
        ("brightness between frames, rms", "frame_offsets", ".3f"),
        ("color of one spot between views, degrees", "angle_deg", ".2f"),
        ("spots neither dark nor clipped", "spots", "d"),
    )
    methods = {"corrected": report.corrected, "raw images": report.raw, **report.others}
    rows = [
        (what, *(format(getattr(spread, name), style) for spread in methods.values()))
        for what, name, style in measures
    ]
    for number, what in enumerate(("brightness", "red over green", "blue over green")):
        borders = (
            (spread.border[number], spread.border_error[number]) for spread in methods.values()
        )
        rows.append(
            (
                f"{what} of a spot at the border over at the center",
                *(f"{trend:+.3f} +- {e:.3f}" for trend, e in borders),
            )
        )
    far = (format(spread.far_red_to_blue, ".3f") for spread in methods.values())
    rows.append(("red/blue, farthest 15 % over nearest 25 %, even reef = 1", *far))
    return table(("between frames", *methods), rows) + lines(
        f"{report.pairs} pairs of frames; brightness, and changes at the border (the outer "
        "tenth), as natural logarithm of a ratio"
    )


def water_text(result: "MeasuredWater") -> str:
    """The measured water, and the option that uses it."""
    use = f"use it with: stereo-seecolor run ... --water {shlex.quote(str(result.path))}"
    if result.charts:
        return lines(*_white_lines(result), use)
    errors = result.water.standard_errors["y"]
    rates = ", ".join(
        f"{name} {rate:.3f} +- {error:.3f}"
        for name, rate, error in zip(("red", "green", "blue"), result.water.y, errors, strict=True)
    )
    return lines(
        f"attenuation at long range, 1/m: {rates} (nan: the observations do not determine it)", use
    )


def _white_lines(result: "MeasuredWater") -> list[str]:
    from stereo_seecolor.color.white_point import white_errors

    red, green, blue = result.water.white
    red_error, blue_error = white_errors(result.water)
    each = [
        f"{chart.frame}: {chart.target} at {chart.range_m:.2f} m: {chart.residual_deg:.1f} "
        "degrees from the common white point"
        + (
            ""
            if isnan(chart.ciede2000)
            else f"; CIEDE2000 {chart.ciede2000_before:.1f}, {chart.ciede2000:.1f} with the matrix"
        )
        for chart in result.charts
    ]
    left_out = [f"not used: {name}, similar to a white card" for name in result.left_out]
    first = (
        f"white point relative to green, from {counted(len(each), 'target')}: red "
        f"{red / green:.3f} +- {red_error:.1%}, blue {blue / green:.3f} +- {blue_error:.1%}"
    )
    doubts = [f"note: {doubt}" for doubt in result.doubts]
    matrix = [] if all(isnan(chart.ciede2000) for chart in result.charts) else _matrix_lines(result)
    return [first, *each, *left_out, *doubts, *_trend_lines(result), *matrix]


def _trend_lines(result: "MeasuredWater") -> list[str]:
    if not result.trend:
        return ["all targets are at one range: they cannot test the attenuation and backscatter"]
    (red, blue), errors = result.trend.per_m, result.trend.error
    return [
        f"residual change over range, {result.trend.near_m:.1f} to {result.trend.far_m:.1f} m (0 "
        f"if the water parameters are correct): relative to green, red {red:+.1%} +- "
        f"{errors[0]:.1%} per meter, blue {blue:+.1%} +- {errors[1]:.1%}"
    ]


def _matrix_lines(result: "MeasuredWater") -> list[str]:
    found = result.matrix
    if not found:
        return [f"no color matrix: {result.no_matrix}"]
    rows = (
        f"  {name:5} = "
        + "  ".join(
            f"{value:+.3f} +- {error:.3f} {of}"
            for value, error, of in zip(row, errors, ("red", "green", "blue"), strict=True)
        )
        for name, row, errors in zip(
            ("red", "green", "blue"), found.matrix, found.errors, strict=True
        )
    )
    noise = ", ".join(f"{factor:.2f}" for factor in found.noise)
    return [
        f"color matrix, from {found.patches} patches (noise of red, green, blue times {noise}):",
        *rows,
        f"  median CIEDE2000 of the patches {found.before:.1f} without it, {found.after:.1f} with "
        f"it, {found.left_out:.1f} on patches left out of the fit",
    ]
