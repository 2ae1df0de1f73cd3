"""Metrics, change and markers of a reef, as text."""

from math import isfinite
from typing import TYPE_CHECKING

from stereo_seecolor.cli.text import lines, table

if TYPE_CHECKING:
    from stereo_seecolor.extras.reef.compare import Comparison
    from stereo_seecolor.extras.reef.markers import FoundMarkers
    from stereo_seecolor.extras.reef.measure import Measurement
    from stereo_seecolor.extras.reef.metric_tables import SiteMetrics


def metrics_text(result: "SiteMetrics") -> str:
    """Structure at each scale, then any outlines and cover; each number with standard error."""
    head = f"{result.area_m2:.2f} m2 seen, cells of {1000 * result.cell_m:g} mm"
    parts = [
        lines(
            f"{head}, standard error of a height {1000 * result.height_std_m:.1f} mm (median, more "
            "at rims)",
            *([f"note: {result.note}"] if result.note else []),
        ),
        _structure(result),
    ]
    if result.colonies:
        parts += [_outlines(result), _cover(result), lines(*_doubts(result))]
    if result.point_cover:
        parts.append(_point_cover(result))
    if result.unseen_points:
        parts.append(lines(f"points off or in gaps of the map: {result.unseen_points}"))
    parts += [
        lines(*(f"not seen, or smaller than a cell: {name}" for name in result.unseen)),
        lines(*(f"  {path}" for path in result.files)),
    ]
    return "\n".join(part for part in parts if part)


SAID_FROM = 0.05
"""Fraction of an outline, unseen or shared with others, from which on a line reports it."""


def _doubts(result: "SiteMetrics") -> list[str]:
    unseen = [
        f"partly seen: {each.name}: {each.unseen:.0%} of it is assumed to be like the rest; the "
        "standard error includes this"
        for each in result.colonies
        if each.unseen > SAID_FROM
    ]
    shared = [each.name for each in result.colonies if each.counted < 1 - SAID_FROM]
    overlap = (
        [f"overlapping: {', '.join(shared)}: the cover counts shared area once, divided among them"]
        if shared
        else []
    )
    return unseen + overlap


def comparison_text(comparison: "Comparison") -> str:
    """The quality of the registration, total changes, changed patches, files."""
    change, at = comparison.change, comparison.change.registration
    lod_mm = 1000 * change.difference.median_lod_m
    fits = f"{at.stable:.0%} of the ground fits, within {1000 * at.spread_m:.1f} mm"
    beyond = (
        f"level of detection {lod_mm:.1f} mm, {change.beyond_lod:.1%} of the cells beyond it (5 "
        "% by chance)"
    )
    head = [
        f"registered: {at.agreeing} of {at.matches} features agree, within "
        f"{1000 * at.feature_rms_m:.1f} mm; {fits}",
        f"{change.overlap_m2:.2f} m2 in both; {beyond}",
        f"scale: lengths of the first are {at.scale:.4f} +- {at.scale_std:.4f} of the second's",
        *(f"note: {note}" for note in (at.scale_note, comparison.position_note) if note),
        "growth {:.3f} +- {:.3f} l".format(*change.growth_l)
        + ", loss {:.3f} +- {:.3f} l".format(*change.loss_l),
    ]
    if comparison.joint:
        head.append(
            f"joint graph: {comparison.joint.pairs} pairs of frames move the second track by "
            f"{1000 * comparison.joint.bent_m:.1f} mm RMS; to remove this, fuse it with --poses "
            "second_track.tum --set mapping.poses_of=rectified --set mapping.poses=given"
        )
    return (
        lines(*head)
        + "\n"
        + _patches(comparison)
        + lines(*(f"  {path}" for path in comparison.files))
    )


def _patches(comparison: "Comparison") -> str:
    rows = [
        (
            f"{patch.number}",
            patch.kind,
            f"{patch.x_m:.2f}, {patch.y_m:.2f}",
            f"{patch.area_cm2:.0f}",
            f"{1000 * patch.mean_m:+.1f}",
            f"{patch.volume_l:+.3f} +- {patch.volume_std_l:.3f}"
            if patch.kind in ("growth", "loss")
            else "",
            f"{patch.lightness:+.0f}, {patch.chroma:+.0f}",
        )
        for patch in comparison.change.patches
    ]
    return (
        table(("patch", "change", "x, y m", "cm2", "height mm", "liters", "L*, C*"), rows) + "\n"
        if rows
        else "no patch of change\n\n"
    )


def _structure(result: "SiteMetrics") -> str:
    """A table with a column for each scale; standard errors in parentheses, in last digits."""
    if not result.structure:
        return "no square of 0.25 m or more was seen well enough\n"
    names = tuple(vars(result.structure[0].mean))
    rows = [("squares", *(f"{each.squares}" for each in result.structure))]
    rows += [
        ("heights averaged over, mm", *(f"{1000 * each.scale_m:g}" for each in result.structure))
    ]
    rows += [
        (
            name,
            *(
                _concise(vars(each.mean)[name], vars(each.standard_error)[name])
                for each in result.structure
            ),
        )
        for name in names
    ]
    heads = ("in squares of", *(f"{each.edge_m:g} m" for each in result.structure))
    return table(heads, rows) + "1.398(2): 1.398 with a standard error of 0.002\n"


def _concise(value: float, error: float) -> str:
    """A value with its standard error, if it has one, in units of the last digit."""
    if not isfinite(value):
        return "-"
    return f"{value:.3f}({1000 * error:.0f})" if isfinite(error) else f"{value:.3f}"


def _with_error(value: float, error: float, digits: int) -> str:
    return f"{value:.{digits}f} +- {error:.{digits}f}" if isfinite(value) else "-"


def _outlines(result: "SiteMetrics") -> str:
    rows = [
        (
            each.name,
            each.label,
            _with_error(1e4 * size.planar_m2, 1e4 * error.planar_m2, 0),
            _with_error(1e4 * size.surface_m2, 1e4 * error.surface_m2, 0),
            _with_error(100 * size.height_m, 100 * error.height_m, 1),
            _with_error(size.volume_l, error.volume_l, 2),
        )
        for each in result.colonies
        for size, error in [(each.measured, each.standard_error)]
    ]
    return table(("outline", "label", "planar cm2", "surface cm2", "height cm", "volume l"), rows)


def _cover(result: "SiteMetrics") -> str:
    rows = [
        (
            each.label,
            f"{each.outlines}",
            f"{each.surface_m2:.4f} +- {each.surface_std_m2:.4f}",
            f"{each.of_seen:.2%}",
            f"{each.of_outlined_planar:.1%}",
            f"{each.of_outlined_surface:.1%} +- {each.of_outlined_surface_std:.1%}",
        )
        for each in result.cover
    ]
    return table(
        (
            "label",
            "n",
            "surface m2",
            "of the area seen",
            "of the area outlined",
            "of the surface outlined",
        ),
        rows,
    )


def _point_cover(result: "SiteMetrics") -> str:
    rows = [
        (each.label, f"{each.points}", f"{each.fraction:.1%}", f"{each.low:.1%} to {each.high:.1%}")
        for each in result.point_cover
    ]
    return table(("label", "points", "of the points", "95 % interval"), rows)


def markers_text(markers: "FoundMarkers") -> str:
    """Each marker, then the scale by sizes and bars, then the residuals of surveyed positions."""
    rows = [
        (
            f"{each.number}",
            f"{each.views}",
            f"{each.x_m:.3f}, {each.y_m:.3f}, {each.z_m:.3f}",
            f"{1000 * each.residual_m:.1f}",
            f"{1000 * each.edge_m:.2f} +- {1000 * each.edge_std_m:.2f}",
        )
        for each in markers.markers
    ]
    text = [table(("marker", "frames", "x, y, z m", "residual mm", "edge mm"), rows)]
    checks = ([("edges", markers.size)] if markers.size else []) + [
        (f"bar {name}", check) for name, check in markers.bars.items()
    ]
    for name, check in checks:
        doubt = f": {check.cause(one for _, one in checks)}" if check.wrong else ""
        text.append(
            lines(f"{name}: measured divided by given {check.ratio:.4f} +- {check.std:.4f}{doubt}")
        )
    if markers.control:
        text.append(
            lines(
                f"surveyed positions: {len(markers.control.residuals_m)} found, "
                f"{1000 * markers.control.rms_m:.1f} mm RMS"
            )
        )
        text += [lines(markers.control.doubt)] if markers.control.doubt else []
    text += [lines(doubt) for doubt in markers.doubts]
    if markers.not_found:
        bars = ", ".join(markers.not_found)
        text.append(lines(f"bars of which a marker was not found in two frames: {bars}"))
    return "\n".join(text) + lines(*(f"  {path}" for path in markers.files))


def measures_text(results: "list[Measurement]") -> str:
    """Measurements as CSV, in meters and square meters; "" for none."""
    # loads pydantic, which --help does without
    from stereo_seecolor.files.csv_tables import csv_text

    return (
        csv_text(vars(results[0]), (vars(result).values() for result in results)) if results else ""
    )
