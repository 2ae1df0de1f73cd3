"""The command water, which measures attenuation and backscatter from overlapping frames, or the white point from charts."""

import shlex
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calibration.wording import counted
from stereo_seecolor.cli import options as opt
from stereo_seecolor.cli.console import lines
from stereo_seecolor.cli.report import LoggedReport

if TYPE_CHECKING:
    from stereo_seecolor.extras.evaluation.water import MeasuredWater

Poses = Annotated[Path | None, opt.option("--poses", "FILE", "Trajectory of the dive (TUM, KITTI, COLMAP, AUV tables).")]
Chart = Annotated[bool, opt.flag("--chart", "White point and color matrix from color charts and white cards in the frames.")]
Targets = Annotated[
    Path | None, opt.option("--targets", "FILE", "JSON of chart corners and polygons. Default: charts are searched for.")
]


def water(
    out: opt.Finished,
    poses: Poses = None,
    chart: Chart = False,
    targets: Targets = None,
    *,
    settings: opt.Settings,
    report: LoggedReport,
) -> None:
    """Measure the water of a run, for run --water: from spots that several frames see (--poses), or from charts (--chart)."""
    from stereo_seecolor.errors import InputError
    from stereo_seecolor.extras.evaluation.water import measure_water, measure_white

    with report.working():
        if (poses is None) != chart:
            raise InputError("water: give --poses FILE for attenuation and backscatter, or --chart for the white point")
        result = measure_water(out, poses, settings.load(run=out)) if poses else measure_white(out, targets)
    report.end({"out": out, **vars(result)}, water_text(result))


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
    return lines(f"attenuation at long range, 1/m: {rates} (nan: the sightings do not determine it)", use)


def _white_lines(result: "MeasuredWater") -> list[str]:
    white = result.water.white
    errors = result.water.standard_errors["white"] / white
    shown = ", ".join(
        f"{name} {value:.3f} +- {error:.1%}"
        for name, value, error in zip(("red", "green", "blue"), white / white[1], errors, strict=True)
    )
    each = [
        f"{chart.frame}: {chart.target} at {chart.range_m:.2f} m: {chart.residual_deg:.1f} degrees from the white of all"
        + ("" if isnan(chart.ciede2000) else f"; CIEDE2000 {chart.ciede2000_before:.1f}, {chart.ciede2000:.1f} with the matrix")
        for chart in result.charts
    ]
    left_out = [f"not used: {name}, which looks like a white card" for name in result.left_out]
    first = f"white point against green, from {counted(len(each), 'target')}: {shown}"
    return [first, *each, *left_out, *_trend_lines(result), *_matrix_lines(result)]


def _trend_lines(result: "MeasuredWater") -> list[str]:
    if not result.trend:
        return ["the charts are at one range: they do not check the water"]
    (red, blue), errors = result.trend.per_m, result.trend.error
    return [
        f"left over range, {result.trend.near_m:.1f} to {result.trend.far_m:.1f} m (0 where the water is right): against green, "
        f"red {red:+.1%} +- {errors[0]:.1%} a meter, blue {blue:+.1%} +- {errors[1]:.1%}"
    ]


def _matrix_lines(result: "MeasuredWater") -> list[str]:
    found = result.matrix
    if not found:
        return [f"no color matrix: {result.no_matrix}"]
    rows = (
        f"  {name:5} = "
        + "  ".join(
            f"{value:+.3f} +- {error:.3f} {of}" for value, error, of in zip(row, errors, ("red", "green", "blue"), strict=True)
        )
        for name, row, errors in zip(("red", "green", "blue"), found.matrix, found.errors, strict=True)
    )
    noise = ", ".join(f"{factor:.2f}" for factor in found.noise)
    return [
        f"color matrix, from {found.patches} patches (noise of red, green, blue times {noise}):",
        *rows,
        f"  median CIEDE2000 of the patches {found.before:.1f} without it, {found.after:.1f} with it, {found.left_out:.1f} on "
        "patches left out of the fit",
    ]
