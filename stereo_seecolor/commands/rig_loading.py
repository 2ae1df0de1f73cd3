"""The calibration file of a dive, read for the images of the dive."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path
from shlex import quote

from calibration import CalibrationError, StereoRig
from calibration.formats import load_rig_of_images
from calibration.port import flat_port
from calibration.resizing import wrong_size
from calibration.rig import for_channels
from calibration.verification.conventions import resolve_convention
from stereo_seecolor.checks.sample import DECIDING_PAIRS, evenly_spaced, first_images
from stereo_seecolor.config import InputConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.dive_pairs import pair_sides
from stereo_seecolor.inputs.halves import is_half
from stereo_seecolor.inputs.images import read_image
from stereo_seecolor.inputs.pairing import Pair, Pairing
from stereo_seecolor.inputs.video_frames import is_video
from stereo_seecolor.plugins import load
from stereo_seecolor.records import Image, is_monochrome

REFINING_PAIRS = 8
"""Pairs that refine a rig before a run: on a real dive six leave the 0.11 px of twelve."""


def pairs_of(left: Path, right: Path, images: InputConfig) -> Pairing:
    """The pairs of two sides as ``run`` takes them. Raises InputError, DeviceError."""
    if not (is_video(left) and is_video(right)):
        return pair_sides(left, right, images)
    pairing: Pairing = load("inputs", "videos").pair_again(left, right, images)
    return pairing


def load_unsettled(calib: str | Path, pairs: Sequence[Pair], images: InputConfig) -> StereoRig:
    """The rig of a calibration file. Where the file states no image size, it is that of the first
    image that can be read.

    A file that can be read in several ways is not settled: the rig keeps its alternatives. Raises
    InputError; CalibrationError, also where the first images all have another size.
    """
    image = next(_left_images(pairs, images))
    size, is_gray = _size(image), is_monochrome(image)
    rig = behind_port(for_channels(load_rig_of_images(calib, size), is_gray), images)
    if rig.left.image_size != size and (other := other_size(rig, pairs, images)):
        _refuse_one_side(pairs[0], other, rig)
        raise CalibrationError(wrong_size("left", other, rig.left.image_size, str(calib)))
    return rig


def other_size(
    rig: StereoRig, pairs: Sequence[Pair], images: InputConfig
) -> tuple[int, int] | None:
    """The size of the first left image, where none of the first ones has the calibrated size."""
    sizes = map(_size, islice(_left_images(pairs, images), DECIDING_PAIRS))
    first = next(sizes)
    return None if rig.left.image_size in (first, *sizes) else first


def _refuse_one_side(pair: Pair, half: tuple[int, int], rig: StereoRig) -> None:
    """Raise InputError where one side's folder was given twice.

    Its images were then taken for side-by-side pairs and cut in two, while a whole one has the
    calibrated size.
    """
    width, height = half
    if is_half(pair.left) and rig.left.image_size in ((2 * width, height), (width, 2 * height)):
        folder = pair.left.parents[2]
        raise InputError(
            f"{folder}: is given as --left and --right, but its images show one side each: give "
            "the folder of the other side as --right; if this folder holds both sides, "
            f"stereo-seecolor inspect {quote(str(folder))} finds a pattern for each"
        )


def behind_port(rig: StereoRig, images: InputConfig) -> StereoRig:
    """The rig behind the flat port of the settings, if they have one. Raises CalibrationError."""
    if images.flat_port is None:
        return rig
    if rig.port is not None:
        raise CalibrationError(
            "input.flat_port: the calibration describes a port already: leave one of them out"
        )
    port = flat_port(images.flat_port)
    readings = [
        replace(reading, medium="air", port=port, alternatives=())
        for reading in (rig, *rig.alternatives)
    ]
    return readings[0].with_alternatives(readings[1:])


def _left_images(pairs: Sequence[Pair], images: InputConfig) -> Iterator[Image]:
    """The left images that can be read. Raises InputError if none can be."""
    problems = []
    for pair in pairs:
        try:
            image = read_image(pair.left, images)
        except InputError as error:
            problems.append(str(error))
        else:
            yield image
    if len(problems) == len(pairs):
        raise InputError(
            f"none of the {len(problems)} left images can be read; the first: {problems[0]}"
        )


def _size(image: Image) -> tuple[int, int]:
    return image.shape[1], image.shape[0]


def load_rig_for(calib: str | Path, pairs: Sequence[Pair], images: InputConfig) -> StereoRig:
    """``load_unsettled``, and the reading of a file that can be read in several ways settled on
    pairs of the dive.

    The first pairs decide, or pairs spread over the dive where the first show too little (a
    descent, black frames).
    """
    rig = load_unsettled(calib, pairs, images)
    try:
        return resolve_convention(rig, first_images(pairs, images))
    except CalibrationError:
        return resolve_convention(
            rig, first_images(evenly_spaced(pairs, REFINING_PAIRS), images, REFINING_PAIRS)
        )
