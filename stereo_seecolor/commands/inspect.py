"""Look at what came off the boat, say what it is, and which ``run`` command fits it. Nothing is written."""

import shlex
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calibration import CalibrationError, Rectification, StereoRig
from calibration.checks import RowCheck, suspicions, vertical_disparity
from calibration.formats.kitti import for_channels
from calibration.mistakes import Mistake, likely_mistake, may_be_mistaken
from calibration.port import FLAT_PORT
from calibration.quick_look import quick_look
from calibration.readings import settle_reading
from calibration.resizing import wrong_size
from stereo_seecolor.commands.check import RigFacts, rig_facts
from stereo_seecolor.commands.dive_rig import DECIDING_PAIRS, spread
from stereo_seecolor.commands.inspect_dive import Measured, Misfit, alike, measure, misfits
from stereo_seecolor.commands.inspect_images import problems_of_images
from stereo_seecolor.commands.inspect_poses import FoundPoses, find_poses
from stereo_seecolor.commands.inspect_rig import FoundCalibration, find_calibration, refused_calibrations
from stereo_seecolor.commands.range_limits import RangeLimits, range_limits
from stereo_seecolor.commands.stereo_inputs import settle_storage
from stereo_seecolor.config import RunConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.dive_pairs import pair_sides
from stereo_seecolor.inputs.frames import FrameReader
from stereo_seecolor.inputs.halves import SIDES, half_of
from stereo_seecolor.inputs.image_facts import ImageFacts, image_facts
from stereo_seecolor.inputs.pairing import Pair, Pairing
from stereo_seecolor.inputs.sides import Sides, find_sides
from stereo_seecolor.inputs.video_file import video_file
from stereo_seecolor.inputs.video_images import is_video
from stereo_seecolor.inputs.video_streams import gray
from stereo_seecolor.records import Image, is_monochrome

SAMPLE_PAIRS = 6
"""Pairs, spread over the dive, that are examined."""

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
    calibrations: all that were found; calibration: the one that was tested. poses: all trajectories.
    misfits: sample pairs that do not show one scene.
    problems: what stands in the way, or should be examined first. run_command: the line that runs it.
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
    poses: tuple[FoundPoses, ...]
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
        return _of_videos(sides, places)
    return _of_images(sides, places)


def _of_images(sides: Sides, places: Sequence[Path]) -> Inspection:
    pairing = pair_sides(sides.left, sides.right, RunConfig().input)
    config, notes = settle_storage(RunConfig(), pairing.pairs)
    sample, unlike = alike(spread(pairing.pairs, SAMPLE_PAIRS), config)
    left, right = image_facts(sample[0].left), image_facts(sample[0].right)
    _refuse_range_maps(sides, left, right)
    found = find_calibration(places, left.size)
    tested = NOTHING_TESTED
    if found:
        _refuse_wrong_sizes(found[0], left, right)
        tested = _tested(found[0], pairing, sample, config)
    problems = (
        *problems_of_images(sides, pairing, _doubtful(sides, tested)),
        *notes,
        *unlike,
        *_missing_calibration(places, found, left.size),
        *_problems_of_calibration(found, tested),
        *(f"range: {limit.note}" for limit in tested.limits),
    )
    return Inspection(
        sides=sides,
        left=left,
        right=right,
        pairs=len(pairing.pairs),
        unpaired=len(pairing.unpaired),
        interval_s=_interval_s(pairing),
        exposure_recorded=_exposure_recorded(sample[0], config),
        calibrations=tuple(one.path for one in found),
        calibration=tested.facts,
        poses=find_poses(places, pairing.pairs, {one.path for one in found}),
        measured=tested.measured,
        misfits=tested.misfits,
        problems=problems,
        run_command=command_line(sides, found, tested),
    )


@dataclass(frozen=True)
class Tested:
    """A calibration compared with sample pairs. fitting: at least one of them shows one scene. limits: ranges to be set.

    mistake: explains why pairs do not fit the calibration.
    """

    facts: CalibrationFacts | None = None
    misfits: tuple[Misfit, ...] = ()
    measured: Measured | None = None
    fitting: bool = True
    limits: tuple[RangeLimits, ...] = ()
    mistake: Mistake | None = None

    @property
    def rows(self) -> RowCheck | None:
        """Vertical disparity on sample pairs, None where too few points were found in both images."""
        return self.facts.rows if self.facts else None

    @property
    def exchanged(self) -> bool:
        """True if left and right are to be exchanged."""
        return self.mistake.exchanged if self.mistake else bool(self.rows and self.rows.swapped)


NOTHING_TESTED = Tested()


def _refuse_range_maps(sides: Sides, left: ImageFacts, right: ImageFacts) -> None:
    """Images with a range map each are no stereo pairs, and another command is for them."""
    maps, images = (sides.left, sides.right) if left.bits == FLOAT_BITS else (sides.right, sides.left)
    if left.bits == right.bits == FLOAT_BITS:
        raise InputError(
            f"{sides.left} and {sides.right}: hold floating-point numbers, images need 8 or 16 bits a channel: save them as "
            "16-bit PNG or TIFF (values of 0 to 1 times 65535)"
        )
    if FLOAT_BITS in (left.bits, right.bits):
        command = shlex.join(["stereo-seecolor", "correct", "--images", str(images), "--range", str(maps)])
        raise InputError(f"{maps}: holds floating-point numbers, no images: if these are range maps in meters, run: {command}")


def _refuse_wrong_sizes(found: FoundCalibration, left: ImageFacts, right: ImageFacts) -> None:
    for side, image, camera in (("left", left, found.rig.left), ("right", right, found.rig.right)):
        if image.size != camera.image_size:
            raise CalibrationError(wrong_size(side, image.size, camera.image_size, str(found.path)))


def _doubtful(sides: Sides, tested: Tested) -> bool:
    """Whether the sides may be none: no name says so, and their sample pairs have too little in common."""
    return sides.guessed and tested.facts is not None and tested.rows is None and tested.mistake is None


def command_line(sides: Sides, found: Sequence[FoundCalibration], tested: Tested = NOTHING_TESTED) -> str:
    """The ``run`` command for what was found, quoted for a shell; LEFT, RIGHT, CALIBRATION stand for what was not found.

    Exchanges sides that are swapped, refines a rig of which a camera has moved, sets limits of range.
    """
    calib, rows = str(found[0].path) if found else "CALIBRATION", tested.rows
    first, second = (sides.right, sides.left) if tested.exchanged else (sides.left, sides.right)
    if _doubtful(sides, tested):
        first, second = Path("LEFT"), Path("RIGHT")
    words = ["stereo-seecolor", "run", "--left", str(first), "--right", str(second), "--calib", calib, "--out", "out"]
    if tested.exchanged and first == second:
        words += ["--set", "input.right_half_first=true"]
    if rows and rows.has_moved:
        words.append("--refine")
    if rows and rows.air_in_water:
        words += ["--set", f"input.flat_port={FLAT_PORT}"]
    words += [word for limit in tested.limits for word in ("--set", limit.option)]
    return shlex.join(words)


def _settled_rig(rig: StereoRig, sample: Sequence[Pair], config: RunConfig) -> StereoRig:
    images = _images(sample, config)
    rig = for_channels(rig, is_monochrome(images[0][0]))
    with suppress(CalibrationError):  # too few points to tell: said of the rows
        return settle_reading(rig, images)
    return rig


def _tested(found: FoundCalibration, pairing: Pairing, sample: Sequence[Pair], config: RunConfig) -> Tested:
    rig = _settled_rig(found.rig, sample[:DECIDING_PAIRS], config)
    wrong = misfits(rig, pairing, sample, config)
    fitting = [pair for pair in sample if pair.name not in {misfit.pair for misfit in wrong}]
    rows: RowCheck | None = None
    images = _images(fitting, config)
    with suppress(CalibrationError):
        rows = vertical_disparity(rig, images)
    mistake = likely_mistake(rig, images[:DECIDING_PAIRS]) if rows is None or may_be_mistaken(rows) else None
    rows = replace(rows, mistake=mistake.line) if rows and mistake else rows
    limits = _range_limits(rig, images, config)
    config = config.model_copy(
        update={"matching": config.matching.model_copy(update={limit.key: limit.fits_m for limit in limits})}
    )
    x_m, y_m, _ = rig.R.T @ rig.T_right_left[:3, 3]
    facts = CalibrationFacts(found.path, found.format, rig_facts(rig), bool(abs(y_m) > abs(x_m)), rows, suspicions(rig))
    useless = not fitting or mistake is not None or (rows is not None and rows.swapped)
    measured = None if useless else measure(rig, fitting, len(pairing.pairs), config)
    return Tested(facts, wrong, measured, bool(fitting), () if useless else limits, mistake)


def _range_limits(rig: StereoRig, images: list[tuple[Image, Image]], config: RunConfig) -> tuple[RangeLimits, ...]:
    rectification = Rectification.from_rig(rig)
    ranges_m = [quick_look(rectification, both).range_m for both in images]
    return range_limits(np.concatenate([np.zeros(0), *ranges_m]), config.matching)


def _images(sample: Sequence[Pair], config: RunConfig) -> list[tuple[Image, Image]]:
    frames = map(FrameReader(config.input).read, sample)
    return [(frame.left, frame.right) for frame in frames]


def _of_videos(sides: Sides, places: Sequence[Path]) -> Inspection:
    size = _video_size(sides)
    found = find_calibration(places, size)
    paths, command = tuple(one.path for one in found), command_line(sides, found)
    problems = (*_missing_calibration(places, found, size), *_problems_of_calibration(found, NOTHING_TESTED))
    return Inspection(sides, None, None, 0, 0, None, False, paths, None, find_poses(places, (), paths), None, (), problems, command)


def _video_size(sides: Sides) -> tuple[int, int]:
    image = gray(video_file(sides.left).frame(0))
    height, width = (half_of(image, SIDES[0], sides.left) if sides.left == sides.right else image).shape
    return width, height


def _interval_s(pairing: Pairing) -> float | None:
    times = [pair.timestamp_s for pair in pairing.pairs if pair.timestamp_s is not None]
    return float(np.median(np.diff(times))) if len(times) > 1 else None


def _exposure_recorded(pair: Pair, config: RunConfig) -> bool:
    frame = FrameReader(config.input).read(pair)
    return frame.left_capture.relative_exposure is not None


def _missing_calibration(places: Sequence[Path], found: Sequence[FoundCalibration], size: tuple[int, int]) -> tuple[str, ...]:
    """What to do where none was found: mend those that were refused, or make one."""
    if found:
        return ()
    refused = refused_calibrations(places, size)
    return refused or ("no calibration was found: make one with 'stereo-seecolor calibrate' from images of a target",)


def _problems_of_calibration(found: Sequence[FoundCalibration], tested: Tested) -> tuple[str, ...]:
    problems = []
    if len(found) > 1:
        names = ", ".join(one.path.name for one in found[:5])
        problems.append(f"{len(found)} calibrations were found, the first was taken: {names}")
    if tested.facts:
        problems += tested.facts.suspicions
        if tested.mistake:
            problems.append(tested.mistake.line)
        elif not tested.fitting:
            problems.append("no sample pair shows one scene: bring left and right images of the same moments together first")
        elif tested.rows is None:
            problems.append("too few points were found in both images of the sample pairs to test the calibration")
        else:
            problems += tested.rows.advice
        problems += ["the run line exchanges the sides"] if tested.exchanged else []
    return tuple(problems)
