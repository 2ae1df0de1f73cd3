"""Commands that only read and print: inspect, doctor, config."""

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from calibration.errors import counted
from stereo_seecolor.cli import options as opt
from stereo_seecolor.cli.command import command
from stereo_seecolor.cli.errors import EXIT_DONE, EXIT_KNOWN_ERROR, EXIT_SOME_FAILED
from stereo_seecolor.cli.output import lines
from stereo_seecolor.cli.report import BareReport, LoggedReport

if TYPE_CHECKING:
    from stereo_seecolor.commands.doctor import Finding
    from stereo_seecolor.commands.inspect import Inspection
    from stereo_seecolor.commands.inspect_dive import SampleMeasures
    from stereo_seecolor.commands.inspect_rig import CalibrationFacts, FoundPoses
    from stereo_seecolor.config.file import Setting
    from stereo_seecolor.inputs.image_facts import ImageFacts
    from stereo_seecolor.inputs.video_frames import VideoFacts


# The command inspect, which examines a dive before a run.

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
        vars(found),
        inspection_text(found),
        EXIT_SOME_FAILED if found.is_wrong else EXIT_DONE,
    )


def inspection_text(found: "Inspection") -> str:
    """The files, the measurements of sample pairs, notes, and the run command."""
    output = [
        f"left:  {found.sides.left}{_image_text(found.left)}",
        f"right: {found.sides.right}{_image_text(found.right)}",
    ]
    if found.pairs:
        every = f", one every {found.interval_s:.3g} s" if found.interval_s else ""
        exposure = "recorded with each image" if found.exposure_recorded else "not recorded"
        output.append(
            f"{counted(found.pairs, 'pair')}{every}; "
            f"{counted(found.unpaired, 'file without a partner')}; exposure {exposure}"
        )
    if found.calibration:
        output += _calibration_lines(found.calibration)
    output += [_poses_line(poses, found.pairs) for poses in found.poses]
    if found.measured:
        output += _measured_lines(found.measured)
    for misfit in found.misfits:
        fits = (
            f"; the left image of {misfit.pair} fits the right one of {misfit.fits}"
            if misfit.fits
            else ""
        )
        output.append(f"not a pair: {misfit.pair}: its images do not show the same scene{fits}")
    if found.calibration and not found.calibration.rig.states_errors:
        output.append(
            "the images cannot show whether the scale of this calibration is right: "
            "docs/what-it-cannot-know.md"
        )
    return lines(
        *output, *(f"note: {problem}" for problem in found.problems), "", found.run_command
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


def _poses_line(found: "FoundPoses", pairs: int) -> str:
    of_pairs = f", for {found.pairs} of {pairs} pairs by {found.by}" if pairs else ""
    return (
        f"poses: {found.path} ({found.format}): {counted(found.poses, 'pose')}{of_pairs}; for "
        "a map with them add --fuse --poses"
    )


def _measured_lines(measured: "SampleMeasures") -> list[str]:
    light = "strobes or lamps" if measured.strobes else "daylight"
    return [
        f"range: {measured.median_range_m:.2f} m (median), known for {measured.coverage:.0%} of "
        f"the pixels; {measured.ground_resolution_m * 1000:.2f} mm a pixel",
        f"light: {light}; the middle is {measured.center_to_corner:.1f} times as bright as the "
        "corners",
        f"a run takes about {_duration(measured.seconds)} here and "
        f"{measured.disk_bytes / 1e9:.2f} GB of disk",
    ]


def _duration(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 120 else f"{seconds / 60:.0f} minutes"


# Commands about this machine and the settings of this program: doctor, config.

Show = Annotated[bool, opt.flag("--show", "The default of this command; accepted for scripts.")]


@command("This program", "doctor")
def doctor(report: BareReport) -> None:
    """Check the installation: what is installed, what is missing, what needs it, and how to install
    it.
    """
    from stereo_seecolor.commands.doctor import doctor as examine

    found = examine()
    content = {"ready": found.ready, "findings": found.findings}
    report.end(content, doctor_text(found.findings), EXIT_DONE if found.ready else EXIT_KNOWN_ERROR)


def doctor_text(findings: "Sequence[Finding]") -> str:
    """A line for each part of the installation, with the remedy for a missing one, and whether the
    program can run.
    """
    output = []
    for finding in findings:
        output.append(f"{_state(finding):8}  {finding.what}: {finding.detail}")
        if not finding.ok and finding.without:
            output.append(f"          without it: {finding.without}")
        if finding.fix:
            output.append(f"          fix it with: {finding.fix}")
    missing = [finding.what for finding in findings if finding.needed and not finding.ok]
    verdict = (
        f"not ready: {', '.join(missing)} must be installed first"
        if missing
        else "ready: everything that a run needs is installed"
    )
    return lines(*output, verdict)


def _state(finding: "Finding") -> str:
    """The state of a part in one word: ok, MISSING, or optional for a missing part that a run does
    not need.
    """
    if finding.ok:
        return "ok"
    return "MISSING" if finding.needed else "optional"


@command(
    "This program",
    "config --show --set color.lock=survey",
    "config --config OUT/run.json > settings.yaml",
)
def config(show: Show = True, *, settings: opt.Settings, report: BareReport) -> None:
    """Print the merged settings as YAML, each with its origin: the default, the file, or --set."""
    from stereo_seecolor.config.file import load_settings

    merged = load_settings(settings.config, settings.settings or [])
    report.end(
        {"settings": merged},
        lines(*_section([(setting.key.split("."), setting) for setting in merged], 0)),
    )


def _section(entries: "list[tuple[list[str], Setting]]", depth: int) -> list[str]:
    """Lines of YAML that --config can read, with each setting's origin as a comment. entries: (keys
    below this depth, setting).
    """
    output = []
    for name, group in groupby(entries, key=lambda entry: entry[0][0]):
        inside = list(group)
        if len(inside[0][0]) > 1:
            output += [
                f"{'  ' * depth}{name}:",
                *_section([(keys[1:], setting) for keys, setting in inside], depth + 1),
            ]
        else:
            setting = inside[0][1]
            output.append(f"{'  ' * depth}{name}: {_yaml(setting.value)}  # {setting.origin}")
    return output


def _yaml(value: Any) -> str:
    import yaml

    from stereo_seecolor.files.json_values import plain

    text: str = yaml.safe_dump(plain(value), default_flow_style=True, width=10**6)
    return text.removesuffix("\n").removesuffix("\n...")
