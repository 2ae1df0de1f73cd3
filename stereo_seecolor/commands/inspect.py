"""``inspect``: identify the files of a dive, name problems, and give the ``run`` command that fits.
Nothing is written.
"""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibration import CalibrationError
from calibration.port import FLAT_PORT
from calibration.resizing import wrong_size
from stereo_seecolor.checks.camera_response import settle_response
from stereo_seecolor.checks.dive import IMAGE_CHECKS
from stereo_seecolor.checks.sample import DiveImages, evenly_spaced
from stereo_seecolor.checks.verdict import RANGES, verdict_of
from stereo_seecolor.commands.inspect_check import (
    NOTHING_TESTED,
    CalibrationFacts,
    Tested,
    tested_calibration,
)
from stereo_seecolor.commands.inspect_dive import Misfit, SampleMeasures, alike
from stereo_seecolor.commands.inspect_poses import FoundPoses, find_poses
from stereo_seecolor.commands.inspect_problems import (
    calibration_problems,
    clock_notes,
    missing_calibration,
    one_camera_notes,
    pairing_problems,
    unknown_files,
)
from stereo_seecolor.commands.inspect_rig import FoundCalibration, find_calibration
from stereo_seecolor.commands.stereo_inputs import settle_storage
from stereo_seecolor.config import RunConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.dive_pairs import pair_sides
from stereo_seecolor.inputs.frame_reader import FrameReader
from stereo_seecolor.inputs.image_facts import ImageFacts, image_facts
from stereo_seecolor.inputs.listing import EXTENSIONS, unread_hint
from stereo_seecolor.inputs.pairing import Pairing
from stereo_seecolor.inputs.patterns import folder_of, is_pattern
from stereo_seecolor.inputs.sides import Sides, find_sides
from stereo_seecolor.inputs.video_frames import VideoFacts, is_video, size_of_side, video_facts
from stereo_seecolor.records import Numbers

SAMPLE_PAIRS = 6
"""Pairs, spread over the dive, that are examined."""

FLOAT_BITS = 32
"""A camera's images have 8 or 16 bits a channel; range maps are floating-point."""


@dataclass(frozen=True)
class Inspection:
    """The files of a dive, and what sample pairs of it show.

    sides: folders or videos of both sides. left, right: facts of the first images, or
    of the videos.
    pairs, unpaired: numbers of pairs and of images without a partner; 0 for videos, which ``run``
    pairs.
    interval_s: median time between pairs, None where names hold no time. exposure_recorded: EXIF
    holds exposure or gain.
    calibrations: all that were found; calibration: the one that was tested. poses: all
    trajectories.
    misfits: sample pairs that do not show one scene. agrees: False where no pair does, or where the
    images cannot be those of the calibration. wrong: numbers of a run of these files that would be
    wrong by more than they state. problems: lines on what prevents a run or should be examined
    before.
    run_command: the command line that fits.
    """

    sides: Sides
    left: ImageFacts | VideoFacts
    right: ImageFacts | VideoFacts
    pairs: int = 0
    unpaired: int = 0
    interval_s: float | None = None
    exposure_recorded: bool = False
    calibrations: tuple[Path, ...] = ()
    calibration: CalibrationFacts | None = None
    poses: tuple[FoundPoses, ...] = ()
    measured: SampleMeasures | None = None
    misfits: tuple[Misfit, ...] = ()
    agrees: bool = True
    wrong: tuple[Numbers, ...] = ()
    problems: tuple[str, ...] = ()
    run_command: str = ""

    @property
    def is_wrong(self) -> bool:
        """True if a run of these files would end with exit code 3, or with an error."""
        rows = self.calibration.rows if self.calibration else None
        return bool(self.misfits or not self.agrees or self.wrong or (rows and rows.odd))


def inspect(places: Sequence[Path]) -> Inspection:
    """Examine files and folders, with all folders below them, for images or videos of both sides,
    calibrations and trajectories.

    Raises InputError for a place that does not exist, where no two sides are found, or where none
    of their images can be read.
    """
    for place in places:
        if not folder_of(place).exists():
            raise InputError(f"{place}: does not exist")
    sides = find_sides(_searched(places))
    if is_video(sides.left):
        return _of_videos(sides, places)
    return _of_images(sides, places)


def _searched(places: Sequence[Path]) -> list[Path]:
    """Where the sides may be: folders, videos, and the folders of images and patterns."""
    found: dict[Path, None] = {}
    for path in places:
        if path.is_dir() or is_video(path):
            found[path] = None
        elif is_pattern(path):
            found[folder_of(path)] = None
        elif path.suffix.lower() in EXTENSIONS:
            found[path.parent] = None
    if not found:
        names = [str(path) for path in places]
        raise InputError(
            f"{', '.join(names)}: no images and no videos: give the folders of the two "
            f"sides{unread_hint(names)}"
        )
    return list(found)


def _of_images(sides: Sides, places: Sequence[Path]) -> Inspection:
    """Inspect a dive of images: pairs, a calibration tested on a sample, and trajectories."""
    pairing = pair_sides(sides.left, sides.right, RunConfig().input)
    config, notes = settle_storage(RunConfig(), pairing.pairs)
    config, response = settle_response(config, pairing.pairs)
    of_images = verdict_of(IMAGE_CHECKS, DiveImages.with_colors(pairing.pairs, config))
    sample, reader = evenly_spaced(pairing.pairs, SAMPLE_PAIRS), FrameReader(config.input)
    frames, unlike = alike(sample, reader)
    first = next(iter(frames), sample[0])
    left, right = image_facts(first.left), image_facts(first.right)
    capture = reader.capture(first.left)
    _refuse_range_maps(sides, left, right)
    found = find_calibration(places, left.size)
    tested = NOTHING_TESTED
    if found:
        _refuse_wrong_sizes(found[0], left.size, right.size)
        frames = frames or {first: reader.read(first)}  # which says why none can be read
        tested = tested_calibration(found[0], pairing, frames, config)
    poses, unread = find_poses(places, pairing.pairs, {one.path for one in found})
    problems = (
        *pairing_problems(sides, pairing, _doubtful(sides, tested)),
        *notes,
        *of_images.notes,
        *response,
        *unlike,
        *missing_calibration(places, found, left.size),
        *calibration_problems(found, tested),
        *(f"range: {limit.note}" for limit in tested.limits),
        *unread,
    )
    known = {*(one.path for one in found), *(one.path for one in poses)}
    problems = (*problems, *unknown_files(places, known, problems))
    return Inspection(
        sides=sides,
        left=left,
        right=right,
        pairs=len(pairing.pairs),
        unpaired=len(pairing.unpaired),
        interval_s=_interval_s(pairing),
        exposure_recorded=capture.relative_exposure is not None,
        calibrations=tuple(one.path for one in found),
        calibration=tested.facts,
        poses=poses,
        measured=tested.measured,
        misfits=tested.misfits,
        agrees=tested.agrees,
        wrong=tuple(sorted(of_images.wrong | _wrong_ranges(sides, tested))),
        problems=problems,
        run_command=command_line(sides, found, tested),
    )


def _refuse_range_maps(sides: Sides, left: ImageFacts, right: ImageFacts) -> None:
    """Raise InputError where a side holds floating-point images: range maps, or unreadable."""
    maps, images = (
        (sides.left, sides.right) if left.bits == FLOAT_BITS else (sides.right, sides.left)
    )
    if left.bits == right.bits == FLOAT_BITS:
        raise InputError(
            f"{sides.left} and {sides.right}: contain floating-point numbers, but images need 8 or "
            "16 bits per channel: save them as 16-bit PNG or TIFF (values of 0 to 1 times 65535)"
        )
    if FLOAT_BITS in (left.bits, right.bits):
        command = shlex.join(
            ["stereo-seecolor", "correct", "--images", str(images), "--range", str(maps)]
        )
        raise InputError(
            f"{maps}: holds floating-point numbers, no images: if these are range maps in meters, "
            f"run: {command}"
        )


def _refuse_wrong_sizes(
    calibration: FoundCalibration, left: tuple[int, int], right: tuple[int, int]
) -> None:
    for side, size, camera in (
        ("left", left, calibration.rig.left),
        ("right", right, calibration.rig.right),
    ):
        if size != camera.image_size:
            raise CalibrationError(wrong_size(side, size, camera.image_size, str(calibration.path)))


def _wrong_ranges(sides: Sides, tested: Tested) -> frozenset[Numbers]:
    """That ranges of these files would be wrong, unless the run line exchanges the sides."""
    rows = tested.rows
    exchanged = tested.exchanged and sides.guessed
    return RANGES if rows and rows.ranges_are_wrong and not exchanged else frozenset()


def _doubtful(sides: Sides, tested: Tested) -> bool:
    """Whether the folders may not be two sides: no name says so, and few points in common."""
    return (
        sides.guessed
        and tested.facts is not None
        and tested.rows is None
        and tested.mistake is None
    )


def command_line(
    sides: Sides, calibrations: Sequence[FoundCalibration], tested: Tested = NOTHING_TESTED
) -> str:
    """The ``run`` command for the files found, quoted for a shell; LEFT, RIGHT, CALIBRATION stand
    for missing ones.

    It exchanges sides that are swapped, refines a rig that has moved, and sets limits of range.
    """
    rows = tested.rows
    calib = (
        "CALIBRATION" if not calibrations or (rows and rows.refusal) else str(calibrations[0].path)
    )
    first, second = (sides.right, sides.left) if tested.exchanged else (sides.left, sides.right)
    if _doubtful(sides, tested):
        first, second = Path("LEFT"), Path("RIGHT")
    words = ["stereo-seecolor", "run", "--left", str(first), "--right", str(second)]
    words += ["--calib", calib, "--out", "out"]
    if tested.exchanged and first == second:
        words += ["--set", "input.right_half_first=true"]
    if rows and rows.has_moved:
        words.append("--refine")
    if rows and rows.air_in_water:
        words += ["--set", f"input.flat_port={FLAT_PORT}"]
    words += [word for limit in tested.limits for word in ("--set", limit.option)]
    return shlex.join(words)


def _of_videos(sides: Sides, places: Sequence[Path]) -> Inspection:
    """Inspect a dive of videos, of which only the index and a frame are read."""
    left, right = video_facts(sides.left), video_facts(sides.right)
    size = size_of_side(sides.left, sides.right)
    found = find_calibration(places, size)
    if found:
        _refuse_wrong_sizes(found[0], size, size if sides.left == sides.right else right.size)
    paths = tuple(one.path for one in found)
    poses, unread = find_poses(places, (), paths)
    problems = (
        *missing_calibration(places, found, size),
        *calibration_problems(found, NOTHING_TESTED),
        *unread,
    )
    return Inspection(
        sides=sides,
        left=left,
        right=right,
        calibrations=paths,
        poses=poses,
        problems=(
            *problems,
            *clock_notes(sides),
            *one_camera_notes(sides, size),
            *unknown_files(places, {*paths, *(one.path for one in poses)}, problems),
        ),
        run_command=command_line(sides, found),
    )


def _interval_s(pairing: Pairing) -> float | None:
    times = [pair.timestamp_s for pair in pairing.pairs if pair.timestamp_s is not None]
    return float(np.median(np.diff(times))) if len(times) > 1 else None
