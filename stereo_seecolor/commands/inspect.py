"""Look at what came off the boat, say what it is, and which ``run`` command fits it. Nothing is written."""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibration import CalibrationError, StereoRig
from calibration.checks import RowCheck, suspicions, vertical_disparity
from calibration.readings import settle_reading
from stereo_seecolor.commands.check import RigFacts, rig_facts
from stereo_seecolor.commands.dive_rig import spread
from stereo_seecolor.commands.inspect_dive import Measured, Misfit, measure, misfits
from stereo_seecolor.commands.inspect_rig import FoundCalibration, find_calibration
from stereo_seecolor.config import RunConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.frames import FrameReader
from stereo_seecolor.inputs.image_facts import ImageFacts, image_facts
from stereo_seecolor.inputs.pairing import Pairing, pair_folders
from stereo_seecolor.inputs.sides import Sides, find_sides
from stereo_seecolor.inputs.video_file import video_file
from stereo_seecolor.inputs.video_images import is_video
from stereo_seecolor.inputs.video_streams import gray

SAMPLE_PAIRS = 6
"""Pairs, spread over the dive, that are looked at."""

FLOAT_BITS = 32
"""A camera's images have 8 or 16 bits a channel; range maps are floating-point."""


@dataclass(frozen=True)
class CalibrationFacts:
    """A calibration that was found, tested on the dive. vertical: the right camera is above or below the left one.

    rows: vertical disparity on sample pairs, None where too few points were found in both images.
    """

    path: Path
    format: str
    rig: RigFacts
    vertical: bool
    rows: RowCheck | None
    suspicions: tuple[str, ...]


@dataclass(frozen=True)
class Inspection:
    """What came off the boat.

    files: image files of both sides, or frames of the videos. pairs, unpaired: of images (0 for videos, which run pairs).
    interval_s: median time between pairs, None where names hold none. exposure_recorded: EXIF holds exposure or gain.
    calibrations: all that were found; calibration: the one that was tested. misfits: sample pairs that do not show one scene.
    problems: what stands in the way, or should be looked at first. run_command: the line that runs it.
    """

    sides: Sides
    left: ImageFacts | None
    right: ImageFacts | None
    pairs: int
    unpaired: int
    interval_s: float | None
    exposure_recorded: bool
    calibrations: tuple[Path, ...]
    calibration: CalibrationFacts | None
    measured: Measured | None
    misfits: tuple[Misfit, ...]
    problems: tuple[str, ...]
    run_command: str


def inspect(places: Sequence[Path]) -> Inspection:
    """Look at folders and files: images or videos of both sides, and a calibration, anywhere in them.

    Raises InputError for a place that is missing, where no two sides are found, or none of their images can be read.
    """
    for place in places:
        if not place.exists():
            raise InputError(f"{place}: does not exist")
    sides = find_sides([path for path in places if path.is_dir() or is_video(path)])
    if is_video(sides.left):
        return _of_videos(sides, find_calibration(places, _video_size(sides)))
    pairing = pair_folders(sides.left, sides.right, RunConfig().input)
    left, right = image_facts(pairing.pairs[0].left), image_facts(pairing.pairs[0].right)
    _refuse_range_maps(sides, left, right)
    found = find_calibration(places, left.size)
    config = RunConfig.model_validate({"input": {"bayer": "rggb"}} if left.kind == "mosaic" else {})
    rig, facts = _tested(found, pairing, config) if found else (None, None)
    wrong = misfits(rig, pairing, spread(pairing.pairs, SAMPLE_PAIRS), config) if rig else ()
    fitting = [pair for pair in spread(pairing.pairs, SAMPLE_PAIRS) if pair.name not in {misfit.pair for misfit in wrong}]
    return Inspection(
        sides=sides,
        left=left,
        right=right,
        pairs=len(pairing.pairs),
        unpaired=len(pairing.unpaired),
        interval_s=_interval_s(pairing),
        exposure_recorded=_exposure_recorded(pairing, config),
        calibrations=tuple(one.path for one in found),
        calibration=facts,
        measured=measure(rig, fitting, len(pairing.pairs), config) if rig and fitting else None,
        misfits=wrong,
        problems=(*_problems_of_images(sides, (left, right), pairing), *_problems_of_calibration(found, facts)),
        run_command=command_line(sides, found, left, refine=bool(facts and facts.rows and facts.rows.has_moved)),
    )


def _refuse_range_maps(sides: Sides, left: ImageFacts, right: ImageFacts) -> None:
    """Images with a range map each are no stereo pairs, and another command is for them."""
    maps, images = (sides.left, sides.right) if left.bits == FLOAT_BITS else (sides.right, sides.left)
    if FLOAT_BITS in (left.bits, right.bits):
        command = shlex.join(["stereo-seecolor", "correct", "--images", str(images), "--range", str(maps)])
        raise InputError(f"{maps}: holds floating-point numbers, no images: if these are range maps in meters, run: {command}")


def command_line(sides: Sides, found: Sequence[FoundCalibration], left: ImageFacts | None, refine: bool = False) -> str:
    """The ``run`` command for what was found, quoted for a shell; CALIBRATION stands where none was found.

    refine: rows say that a camera has moved since the calibration.
    """
    calib = str(found[0].path) if found else "CALIBRATION"
    words = ["stereo-seecolor", "run", "--left", str(sides.left), "--right", str(sides.right), "--calib", calib, "--out", "out"]
    if refine:
        words.append("--refine")
    if left and left.kind == "mosaic":
        words += ["--set", "input.bayer=rggb"]
    if left and left.bits == 16 and left.used_bits in (10, 12, 14):
        words += ["--set", f"input.significant_bits={left.used_bits}"]
    return shlex.join(words)


def _tested(found: Sequence[FoundCalibration], pairing: Pairing, config: RunConfig) -> tuple[StereoRig, CalibrationFacts]:
    first = found[0]
    reader = FrameReader(config.input)
    frames = [reader.read(pair) for pair in spread(pairing.pairs, SAMPLE_PAIRS)]
    images = [(frame.left, frame.right) for frame in frames]
    try:
        rig = settle_reading(first.rig, images[:3])
        rows: RowCheck | None = vertical_disparity(rig, images)
    except CalibrationError:
        rig, rows = first.rig, None
    facts = rig_facts(rig)
    vertical = abs(rig.T_right_left[1, 3]) > abs(rig.T_right_left[0, 3])
    return rig, CalibrationFacts(first.path, first.format, facts, bool(vertical), rows, suspicions(rig))


def _of_videos(sides: Sides, found: tuple[FoundCalibration, ...]) -> Inspection:
    paths, command = tuple(one.path for one in found), command_line(sides, found, None)
    problems = _problems_of_calibration(found, None)
    return Inspection(sides, None, None, 0, 0, None, False, paths, None, None, (), problems, command)


def _video_size(sides: Sides) -> tuple[int, int]:
    height, width = gray(video_file(sides.left).frame(0)).shape
    return (width // 2, height) if sides.left == sides.right else (width, height)


def _interval_s(pairing: Pairing) -> float | None:
    times = [pair.timestamp_s for pair in pairing.pairs if pair.timestamp_s is not None]
    return float(np.median(np.diff(times))) if len(times) > 1 else None


def _exposure_recorded(pairing: Pairing, config: RunConfig) -> bool:
    frame = FrameReader(config.input).read(pairing.pairs[0])
    return frame.left_capture.relative_exposure is not None


def _problems_of_images(sides: Sides, images: Sequence[ImageFacts], pairing: Pairing) -> tuple[str, ...]:
    problems = list(pairing.notes)
    if sides.guessed:
        problems.append("no name says which side is left and which right: they were taken in order")
    if pairing.unpaired:
        problems.append(f"{len(pairing.unpaired)} files have no partner, the first: {pairing.unpaired[0].path.name}")
    if len({image.size for image in images}) > 1:
        sizes = " and ".join(f"{width}x{height}" for width, height in (image.size for image in images))
        problems.append(f"left and right images differ in size: {sizes}")
    if any(image.kind == "mosaic" for image in images):
        problems.append("one channel with a color filter pattern: the camera's manual tells whether it is rggb, bggr, gbrg or grbg")
    return tuple(problems)


def _problems_of_calibration(found: Sequence[FoundCalibration], facts: CalibrationFacts | None) -> tuple[str, ...]:
    problems = []
    if not found:
        problems.append("no calibration was found: make one with 'stereo-seecolor calibrate' from images of a target")
    if len(found) > 1:
        names = ", ".join(one.path.name for one in found[:5])
        problems.append(f"{len(found)} calibrations were found, the first was taken: {names}")
    if facts:
        problems += facts.suspicions
        if facts.rows is None:
            problems.append("too few points were found in both images of the sample pairs to test the calibration")
        else:
            problems += facts.rows.advice
    return tuple(problems)
