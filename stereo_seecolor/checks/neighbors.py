"""A check whether the left image of a pair fits the right one of a neighbor: sides out of step."""

import contextlib
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path

from calibration import CalibrationError, Rectification
from calibration.errors import counted
from calibration.verification.matches import describe_left, describe_right
from calibration.verification.same_scene import ENOUGH_POINTS, agreeing_points, is_same_picture
from stereo_seecolor.checks.misfit_causes import flipped_note, stalled_note
from stereo_seecolor.checks.sample import (
    DECIDING_PAIRS,
    consecutive_intervals,
    evenly_spaced,
    matching_threads,
    read_both,
)
from stereo_seecolor.config import InputConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.names import natural_key
from stereo_seecolor.inputs.images import read_image
from stereo_seecolor.inputs.pairing import Pair

NOTED_MISFITS = 3
"""Failed pairs that are compared with their neighbors, as slow as matching some pairs."""
NOTED_PARTS = 5
"""Parts of a dive that are out of step of which each is compared with its neighbors."""
REACH = 4
"""Neighbors examined on either side: numbering is off by one where a frame was dropped, seldom by
more.
"""
FITTING_RATIO = 3.0
"""A fitting pair has so many times the matches of a false one."""
SLIP_PAIRS, SLIP_FRACTION = 5, 0.8
"""Failed pairs that are looked at together: of fewer, each has its own line; and their fraction of
the pairs from the first to the last of them: a few may lack texture, or fit by chance.
"""
PART_PAIRS = 2
"""The least of a part that is out of step: one alone may be dark, or of another moment."""


def neighbor_that_fits(
    pair: Pair, pairs: Sequence[Pair], rectification: Rectification, config: InputConfig
) -> Pair | None:
    """The pair of ``pairs``, in dive order, whose right image shows what the left image of ``pair``
    shows.

    None where it is the pair's own, or where no right image among the next neighbors fits.
    Raises InputError if an image of ``pair`` cannot be read.
    """
    images = read_both(pair, config)
    left = describe_left(rectification, images[0])
    own = agreeing_points(rectification, left, describe_right(rectification, images[1]))
    place = pairs.index(pair)
    others = [
        *pairs[max(0, place - REACH) : place],
        *pairs[place + 1 : place + 1 + REACH],
    ]

    def points_of(other: Pair) -> int:
        try:
            image = read_image(other.right, config)
        except InputError:
            return 0
        return agreeing_points(rectification, left, describe_right(rectification, image))

    points = matching_threads(rectification.raw_size).each(points_of, others)
    found = zip(points, others, strict=True)
    most, best = max(found, key=lambda item: item[0], default=(0, pair))
    return best if most >= max(ENOUGH_POINTS, FITTING_RATIO * own) else None


def constant_shift(pairs: Sequence[Pair], rectification: Rectification, config: InputConfig) -> str:
    """Report a constant shift between the sides, if the left images of some pairs within the dive
    all fit right ones that lie as many pairs later; else "".

    Raises nothing of what a run says of single pairs.
    """
    sample = evenly_spaced(pairs, DECIDING_PAIRS + 2)[1:-1]
    shifts: set[int] = set()
    example, one_camera = "", False
    for pair in sample:
        with contextlib.suppress(InputError, CalibrationError):
            other = neighbor_that_fits(pair, pairs, rectification, config)
            if other is None:
                return ""
            shifts.add(pairs.index(other) - pairs.index(pair))
            example = _fits(pair, other)
            images = read_both(replace(pair, right=other.right), config)
            one_camera = is_same_picture(*images)
    if len(sample) < 2 or len(shifts) != 1:
        return ""
    if one_camera:
        return (
            f"both sides show the images of one camera ({example}: it is the same): give the "
            "images of the other camera for one side"
        )
    return (
        f"left and right are {counted(abs(shifts.pop()), 'image')} out of synchronization: "
        f"{example}, the same in {counted(len(sample), 'pair')}: number both sides "
        "equally, or correct the clock in the names of one side (for videos: input.video_offset_s)"
    )


def misfit_notes(
    pairs: Sequence[Pair],
    failed: Collection[str],
    rectification: Rectification,
    config: InputConfig,
    alone: tuple[Sequence[Path], Sequence[Path]] = ((), ()),
) -> tuple[str, ...]:
    """Report where a camera stalled in the pairs of the names ``failed``, or where they are out of
    step, and by how much; else a line for each of the first few; else that one side is turned or
    mirrored. alone: left and right files without a partner.
    """
    misfits = [(place, pair) for place, pair in enumerate(pairs) if pair.name in failed]
    if stalled := stalled_note(misfits, pairs):
        return (stalled,)
    if slip := _slip(misfits, pairs, rectification, config) or _slips(
        misfits, pairs, rectification, config
    ):
        return (slip,)
    neighbors = tuple(
        f"{_fits(pair, other)}: do both sides have the same numbers?"
        for _, pair in misfits[:NOTED_MISFITS]
        if (other := _fitting(pair, pairs, rectification, config))
    )
    if neighbors:
        return neighbors
    counters = _own_counters(misfits, pairs, rectification, config, alone)
    return tuple(filter(None, [counters or flipped_note(misfits, rectification, config)]))


def _slip(
    misfits: Sequence[tuple[int, Pair]],
    pairs: Sequence[Pair],
    rectification: Rectification,
    config: InputConfig,
) -> str | None:
    """Which pair a slip of the pairing begins with, as where one side lost an image; None where the
    failed pairs show none.

    misfits: the failed pairs with their places; nearly all between the first and the last failed.
    """
    if len(misfits) < SLIP_PAIRS or len(misfits) < SLIP_FRACTION * (
        misfits[-1][0] - misfits[0][0] + 1
    ):
        return None
    # the first and the last may have no partner
    examples = [misfits[i] for i in (1, len(misfits) // 2, len(misfits) - 2)]
    fitting = [
        (place, pair, _fitting(pair, pairs, rectification, config)) for place, pair in examples
    ]
    found = [(pairs.index(other) - place, pair, other) for place, pair, other in fitting if other]
    if len(found) < 2 or len({shift for shift, _, _ in found}) > 1:
        return None
    shift, pair, other = found[0]
    short, long = ("left", "right") if shift > 0 else ("right", "left")
    first, last, images = misfits[0][1].name, misfits[-1][1].name, counted(abs(shift), "image")
    return (
        f"from {first} to {last} ({counted(len(misfits), 'pair')} that failed) left and right "
        f"are {images} out of synchronization: {_fits(pair, other)}; {short} lacks {images} "
        f"before {first}, or {long} has too many: number both sides equally from there on"
    )


def _slips(
    misfits: Sequence[tuple[int, Pair]],
    pairs: Sequence[Pair],
    rectification: Rectification,
    config: InputConfig,
) -> str | None:
    """The parts of a dive that are out of step, as by lost images; None for less than two."""
    parts = [
        (first, last)
        for first, last in consecutive_intervals(place for place, _ in misfits)
        if last - first + 1 >= PART_PAIRS
    ]
    found = []
    for first, last in parts[:NOTED_PARTS]:
        place = (first + last + 1) // 2
        if other := _fitting(pairs[place], pairs, rectification, config):
            found.append(
                f"{pairs[first].name} to {pairs[last].name} by {pairs.index(other) - place:+d} "
                f"({_fits(pairs[place], other)})"
            )
    if len(found) < 2:
        return None
    more = (
        f", and {counted(len(parts) - NOTED_PARTS, 'part')} more"
        if len(parts) > NOTED_PARTS
        else ""
    )
    return (
        "left and right are out of synchronization in several parts, for example because both "
        f"sides lost images: {', '.join(found)}{more}: number both sides equally from the "
        "first of these on, or name the files by their times"
    )


def _own_counters(
    misfits: Sequence[tuple[int, Pair]],
    pairs: Sequence[Pair],
    rectification: Rectification,
    config: InputConfig,
    alone: tuple[Sequence[Path], Sequence[Path]],
) -> str | None:
    """That each camera counts on its own, so that only some numbers coincide; None where a left
    image does not fit the right one of its place in order.
    """
    if not alone[0] or len(alone[0]) != len(alone[1]):
        return None
    lefts = sorted([*alone[0], *(pair.left for pair in pairs)], key=_natural)
    rights = sorted([*alone[1], *(pair.right for pair in pairs)], key=_natural)
    pair = misfits[len(misfits) // 2][1]
    other = replace(pair, right=rights[lefts.index(pair.left)])
    if not _fitting(pair, [pair, other], rectification, config):
        return None
    return (
        f"{_fits(pair, other)}: each camera counted its {counted(len(lefts), 'image')} on its own, "
        "and equal numbers are different moments: give both files of a pair the same name"
    )


def _natural(path: Path) -> str:
    return natural_key(str(path))


def _fits(pair: Pair, other: Pair) -> str:
    return f"{pair.left.name} fits {other.right.name}, not {pair.right.name}"


def _fitting(
    pair: Pair, pairs: Sequence[Pair], rectification: Rectification, config: InputConfig
) -> Pair | None:
    """As neighbor_that_fits; None also for a pair that cannot be read or compared."""
    with contextlib.suppress(InputError, CalibrationError):
        return neighbor_that_fits(pair, pairs, rectification, config)
    return None
