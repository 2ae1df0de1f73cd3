"""The command inspect, which examines a dive before a run."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calibration.errors import counted
from stereo_seecolor.cli.command import command
from stereo_seecolor.cli.errors import EXIT_DONE, EXIT_SOME_FAILED
from stereo_seecolor.cli.report import LoggedReport
from stereo_seecolor.cli.text import duration, lines

if TYPE_CHECKING:
    from stereo_seecolor.commands.inspect import Inspection
    from stereo_seecolor.commands.inspect_check import CalibrationFacts
    from stereo_seecolor.commands.inspect_dive import SampleMeasures
    from stereo_seecolor.commands.inspect_poses import FoundPoses
    from stereo_seecolor.inputs.image_facts import ImageFacts
    from stereo_seecolor.inputs.video_frames import VideoFacts


Places = Annotated[
    list[Path],
    typer.Argument(
        metavar="PATH...",
        help="Folders and files of the dive: images or videos, and the calibration.",
    ),
]


@command("A dive", "inspect DIVE", "inspect left right stereo.mat")
def inspect(places: Places, report: LoggedReport) -> None:
    """Recognize the files of a dive, test some pairs, and print the run command for them; exit code
    3 if pairs do not match, or numbers of a run would be wrong.
    """
    from stereo_seecolor.commands.inspect import inspect as look

    with report.working():
        found = look(places)
    report.end(
        vars(found), inspection_text(found), EXIT_SOME_FAILED if found.is_wrong else EXIT_DONE
    )


def inspection_text(inspection: "Inspection") -> str:
    """The files, the measurements of sample pairs, notes, and the run command."""
    output = [
        f"left:  {inspection.sides.left}{_image_text(inspection.left)}",
        f"right: {inspection.sides.right}{_image_text(inspection.right)}",
    ]
    if inspection.pairs:
        every = f", one every {inspection.interval_s:.3g} s" if inspection.interval_s else ""
        exposure = "recorded with each image" if inspection.exposure_recorded else "not recorded"
        output.append(
            f"{counted(inspection.pairs, 'pair')}{every}; "
            f"{counted(inspection.unpaired, 'file without a partner')}; exposure {exposure}"
        )
    if inspection.calibration:
        output += _calibration_lines(inspection.calibration)
    output += [_poses_line(poses, inspection.pairs) for poses in inspection.poses]
    if inspection.measured:
        output += _measured_lines(inspection.measured)
    for misfit in inspection.misfits:
        fits = (
            f"; the left image of {misfit.pair} fits the right one of {misfit.fits}"
            if misfit.fits
            else ""
        )
        output.append(f"not a pair: {misfit.pair}: its images do not show the same scene{fits}")
    if inspection.calibration and not inspection.calibration.rig.states_errors:
        output.append(
            "the images cannot show whether the scale of this calibration is right: "
            "docs/what-it-cannot-know.md"
        )
    return lines(
        *output,
        *(f"note: {problem}" for problem in inspection.problems),
        "",
        inspection.run_command,
    )


def _image_text(image: "ImageFacts | VideoFacts") -> str:
    from stereo_seecolor.inputs.video_frames import VideoFacts

    width, height = image.size
    if isinstance(image, VideoFacts):
        rate = f", {image.rate_hz:.6g} Hz" if image.rate_hz else ""
        return (
            f": {width}x{height} px{rate}, {counted(image.frames, 'frame')}, {image.seconds:.1f} s"
        )
    used = f" ({image.used_bits} used)" if image.used_bits < image.bits else ""
    kind = {"mosaic": "raw, with a color filter pattern"}.get(image.kind, image.kind)
    return f": {width}x{height} px, {image.bits} bit{used}, {kind}"


def _calibration_lines(calibration: "CalibrationFacts") -> list[str]:
    rig, rows = calibration.rig, calibration.rows
    arranged = "vertical" if calibration.vertical else "side by side"
    tested = f"; vertical disparity {rows.row_error_px:.2f} px" if rows else ""
    return [
        f"calibration: {calibration.path} ({calibration.format}): cameras {arranged}, baseline "
        f"{rig.baseline_m * 1000:.1f} mm, focal length {rig.focal_px:.0f} px{tested}"
    ]


def _poses_line(poses: "FoundPoses", pairs: int) -> str:
    of_pairs = f", for {poses.pairs} of {pairs} pairs by {poses.by}" if pairs else ""
    use = "; for a map with them add --fuse --poses" if poses.pairs or not pairs else ""
    return f"poses: {poses.path} ({poses.format}): {counted(poses.poses, 'pose')}{of_pairs}{use}"


def _measured_lines(measured: "SampleMeasures") -> list[str]:
    light = "strobes or lamps" if measured.strobes else "daylight"
    return [
        f"range: {measured.median_range_m:.2f} m (median), known for {measured.coverage:.0%} of "
        f"the pixels; {measured.ground_resolution_m * 1000:.2f} mm a pixel",
        f"light: {light}; the middle is {measured.center_to_corner:.1f} times as bright as the "
        "corners",
        f"ranges and colors of all pairs take about {duration(measured.seconds)} here; the files "
        f"of a run {measured.disk_bytes / 1e9:.2f} GB, without a map (--fuse)",
    ]
