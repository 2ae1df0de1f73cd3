"""Problems of a dive's files, a line each, as ``inspect`` names them."""

import shlex
from collections.abc import Collection, Sequence
from pathlib import Path

from calibration import CalibrationError
from calibration.errors import counted
from calibration.formats import load_rig
from stereo_seecolor.commands.inspect_check import Tested
from stereo_seecolor.commands.inspect_rig import FoundCalibration, refused_calibrations
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.listing import BAG, EXTENSIONS, unread_hint
from stereo_seecolor.inputs.pairing import Pairing
from stereo_seecolor.inputs.sides import Sides
from stereo_seecolor.inputs.trajectories import read_trajectory
from stereo_seecolor.inputs.video_frames import is_video
from stereo_seecolor.inputs.video_streams import recorded_at

NOT_KNOWN = (
    "is not a trajectory of a known format",
    "is not a calibration",
    "cannot be parsed",
    "is not text",
)
"""Of errors that say no more than that a file is something else."""


def pairing_problems(sides: Sides, pairing: Pairing, doubtful: bool) -> tuple[str, ...]:
    """One line for each problem: notes of the pairing, sides that no name tells, files without a
    partner, folders left out.

    doubtful: sample pairs do not tell either which side is left.
    """
    problems = list(pairing.notes)
    if doubtful:
        problems.append(
            f"no name identifies the left images, and {sides.left} and {sides.right} have too "
            "little in common to be the two sides: name them yourself, with a folder for "
            "each or a pattern ('*/im0.png' and '*/im1.png')"
        )
    elif sides.guessed:
        problems.append("no name identifies the left side: the sides were used in order")
    if pairing.unpaired:
        first, count = pairing.unpaired[0], counted(len(pairing.unpaired), "file without a partner")
        problems.append(f"{count}, the first: {first.path.name} ({first.reason})")
    if sides.others:
        problems.append(
            f"left out: {counted(len(sides.others), 'more folder')} of images, the first: "
            f"{sides.others[0]}: each pair of folders is a separate run; "
            f"stereo-seecolor campaign runs them one after the other{_together(sides)}"
        )
    return tuple(problems)


def _together(sides: Sides) -> str:
    """The options that run folders of the same names as one dive; "" where none do."""
    if not (patterns := sides.together):
        return ""
    return "; all of them as one dive: " + shlex.join(
        ["--left", str(patterns[0]), "--right", str(patterns[1])]
    )


def missing_calibration(
    places: Sequence[Path], calibrations: Sequence[FoundCalibration], size: tuple[int, int]
) -> tuple[str, ...]:
    """Where no calibration was found: why files like one were refused, or how to make one."""
    if calibrations:
        return ()
    refused = refused_calibrations(places, size)
    return refused or (
        "no calibration was found: make one with 'stereo-seecolor calibrate' from images of a "
        "target",
    )


def calibration_problems(
    calibrations: Sequence[FoundCalibration], tested: Tested
) -> tuple[str, ...]:
    """A line on each problem of the calibrations found, and of the one that was tested."""
    problems = []
    if len(calibrations) > 1:
        names = ", ".join(one.path.name for one in calibrations[:5])
        problems.append(f"{len(calibrations)} calibrations were found, the first was used: {names}")
    if tested.facts:
        problems += tested.facts.suspicions
        if tested.mistake:
            problems.append(tested.mistake.line)
        elif not tested.fitting:
            problems.append(
                "no sample pair shows one scene with this calibration: first pair left and right "
                "images of the same moments, or give the calibration of this rig"
            )
        elif tested.rows is None:
            problems.append(
                "too few points were found in both images of the sample pairs to test the "
                "calibration"
            )
        else:
            problems += tested.rows.advice
        problems += ["the run line exchanges the sides"] if tested.exchanged else []
    return tuple(problems)


def one_camera_notes(sides: Sides, size: tuple[int, int]) -> tuple[str, ...]:
    """A line for one video hardly wide enough to show two cameras. size: of a half."""
    width, height = size
    if sides.left != sides.right or width >= height:
        return ()
    return (
        f"{sides.left.name} is read as both cameras side by side, {width}x{height} px each: if "
        "it shows only one camera, give the video of the other camera, too",
    )


def clock_notes(sides: Sides) -> tuple[str, ...]:
    """What is known of the offset of two videos."""
    if sides.left == sides.right:
        return ()
    began = [recorded_at(path) for path in (sides.left, sides.right)]
    command = shlex.join(["stereo-seecolor", "sync", str(sides.left), str(sides.right)])
    if began[0] is None or began[1] is None:
        return (f"'run' finds the offset of the two videos; '{command}' prints it",)
    return (
        f"by the clocks of the cameras the right video began {began[1] - began[0]:+.0f} s after "
        f"the left one; 'run' finds the offset of their frames, and '{command}' prints it",
    )


def unknown_files(
    places: Sequence[Path], known: Collection[Path], problems: Sequence[str]
) -> tuple[str, ...]:
    """A line for each file of the places that is not among the known ones, with what it is where
    that can be told.

    problems: lines that name files already.
    """
    files = [
        place
        for place in places
        if place.exists() and not place.is_dir() and place not in known
        if not (place.is_file() and (place.suffix.lower() in EXTENSIONS or is_video(place)))
    ]
    return tuple(_line(file) for file in files if not any(str(file) in line for line in problems))


def _line(file: Path) -> str:
    if BAG.search(file.name):
        return f"not used{unread_hint([str(file)])}"
    for read in (read_trajectory, load_rig):
        try:
            read(file)
        except (InputError, CalibrationError) as error:
            if not any(words in str(error) for words in NOT_KNOWN):
                return f"not used: {error}"
    return f"not used: {file}: is neither images, nor a calibration or trajectory of a known format"
