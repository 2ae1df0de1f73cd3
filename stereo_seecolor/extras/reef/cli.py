"""Commands that measure on a map or in frames: metrics, compare, markers, measure."""

from pathlib import Path
from typing import Annotated

import typer

from stereo_seecolor.cli import options as opt
from stereo_seecolor.cli.command import command
from stereo_seecolor.cli.errors import EXIT_DONE, EXIT_SOME_FAILED
from stereo_seecolor.cli.report import BareReport
from stereo_seecolor.extras.reef.reef_texts import (
    comparison_text,
    markers_text,
    measures_text,
    metrics_text,
)


@command("Ecology", "metrics OUT", "metrics OUT --polygons corals.geojson --out METRICS")
def metrics(
    out: opt.Finished,
    polygons: Annotated[
        Path | None,
        opt.option(
            "--polygons",
            "FILE",
            "Outlines of colonies or bottom types: GeoJSON, or a TagLab project.",
        ),
    ] = None,
    points: Annotated[
        Path | None,
        opt.option(
            "--points",
            "FILE",
            "Labeled points: CoralNet annotations (CSV) of exported tiles or of frames.",
        ),
    ] = None,
    folder: Annotated[
        Path | None, opt.option("--out", "FOLDER", "A new or empty folder for CSV tables.")
    ] = None,
    *,
    report: BareReport,
) -> None:
    """Compute rugosity and structure of a fused run, and colonies and cover from polygons or
    points, with standard errors.
    """
    from stereo_seecolor.extras.reef.metrics import metrics as measure

    with report.working():
        result = measure(out, polygons, folder, points)
    no_point = result.unseen_points and not result.point_cover
    code = EXIT_SOME_FAILED if result.unseen or no_point else EXIT_DONE
    report.end({"out": out, **vars(result)}, metrics_text(result), code, [out])


@command("Ecology", "compare 2024 2025 --out CHANGE")
def compare(
    first: Annotated[Path, typer.Argument(metavar="FIRST", help="Output folder of a fused run.")],
    second: Annotated[
        Path, typer.Argument(metavar="SECOND", help="The same for a later dive at the same site.")
    ],
    folder: Annotated[
        Path | None,
        opt.option("--out", "FOLDER", "A new or empty folder for rasters, tables and images."),
    ] = None,
    joint: Annotated[
        bool,
        opt.flag(
            "--joint",
            "Also estimate the second track together with the first: second_track.tum, for fuse "
            "--poses.",
        ),
    ] = False,
    *,
    report: BareReport,
) -> None:
    """Detect changes between two fused runs of one site: growth, loss and color, with standard
    errors; exit code 3 if lengths of the two differ by more than 2 %, or positions by 100 m.
    """
    from stereo_seecolor.extras.reef.compare import compare as compare_runs
    from stereo_seecolor.extras.reef.comparing.change_files import description

    with report.working():
        found = compare_runs(first, second, folder, joint)
    bent = {"pairs": found.joint.pairs, "bent_m": found.joint.bent_m} if found.joint else None
    content = (
        description(found.change)
        | {"joint": bent}
        | {"first": first, "second": second, "patches": found.change.patches}
        | {"position_note": found.position_note}
    )
    code = EXIT_SOME_FAILED if found.is_wrong else EXIT_DONE
    content = {**content, "files": found.files}
    report.end(content, comparison_text(found), code, [first, second])


@command(
    "Ecology",
    "markers OUT --size 0.2",
    "markers OUT --bars bars.csv --points surveyed.csv --out MARKERS",
)
def markers(
    out: opt.Finished,
    size: Annotated[
        float | None,
        opt.option(
            "--size", "METERS", "Edge length of the black square of the markers, in meters."
        ),
    ] = None,
    family: Annotated[
        str,
        opt.option(
            "--family",
            "NAME",
            "Marker family: 36h11 (AprilTag), aruco-4x4, ...; an unknown name lists all.",
        ),
    ] = "36h11",
    bars: Annotated[
        Path | None, opt.option("--bars", "FILE", "Scale bars: CSV with first, second, length_m.")
    ] = None,
    points: Annotated[
        Path | None,
        opt.option("--points", "FILE", "Surveyed positions: CSV with marker, x_m, y_m, z_m."),
    ] = None,
    folder: Annotated[
        Path | None,
        opt.option("--out", "FOLDER", "A new or empty folder for the table and the track."),
    ] = None,
    *,
    report: BareReport,
) -> None:
    """Detect markers in a fused run; check its scale by marker size and scale bars, and its
    position by surveyed markers.
    """
    from stereo_seecolor.extras.reef.markers import Known
    from stereo_seecolor.extras.reef.markers import markers as find

    with report.working() as listener:
        found = find(out, Known(size, family, bars, points), folder, listener)
    report.end(
        {"out": out, **vars(found)},
        markers_text(found),
        EXIT_SOME_FAILED if found.wrong else EXIT_DONE,
        [out],
    )


@command("Ecology", "measure OUT points.csv", "measure OUT points.csv > lengths.csv")
def measure(
    out: opt.Finished,
    points: Annotated[
        Path,
        typer.Argument(
            metavar="POINTS",
            help="CSV of measure, frame, kind, label, x_px, y_px (on the map x_m, y_m), or the "
            "page's measures.json.",
        ),
    ],
    lengths: Annotated[
        bool,
        opt.flag("--lengths", "Print only the lengths, as a table with EventMeasure's columns."),
    ] = False,
    *,
    report: BareReport,
) -> None:
    """Measure points, lengths and areas in the frames or on the map of a run; prints a CSV with
    standard errors; exit code 3 if a value is unknown.
    """
    from stereo_seecolor.extras.reef.length_table import length_table
    from stereo_seecolor.extras.reef.measure import measure as measure_points

    if lengths:
        table = length_table(out, points)
        report.end({"out": out, "table": table}, table, runs=[out])
    results = measure_points(out, points)
    unknown = any(each.value is None for each in results)
    content = {"out": out, "measures": results}
    code = EXIT_SOME_FAILED if unknown else EXIT_DONE
    report.end(content, measures_text(results), code, [out])
