"""What names two sides' files have in common: keys, time stamps, and the difference of two
clocks.
"""

import re
from bisect import bisect_left
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.files.names import natural_key

# Keys of file names, under which the left and the right file of a pair meet.

Keys = dict[str, list[Path]]
"""Key -> the files of one folder that have it; more than one where the key is ambiguous."""

_CAMERA = "cam|cams|camera|cameras|image|images|img|imgs|im|eye|view|frame|frames"
_SHORT = "cam|img|im|frame"
"""What words for the side are written together with: ``leftcam``, ``imgL``; but an imager is no
right camera.
"""
_LEFT = (
    f"left({_CAMERA})?|({_SHORT})l|lft|lc|lm|l|cam0|linke?|links|gauche|izquierda|sinistra|esquerda"
)
_RIGHT = (
    f"right({_CAMERA})?|({_SHORT})r|rgt|rc|rm|r|cam1|rechte?|rechts|droite?|derecha|destra|direita"
)
"""LC and RM: the left camera in color and the right one in monochrome, as on some rigs."""

_LETTER = r"[^\W\d_]"
"""Of any alphabet: the r of récif is not a word."""

_SIDE_WORDS = {
    side: re.compile(f"(?<!{_LETTER})({words})(?!{_LETTER})", re.IGNORECASE)
    for side, words in (("left", _LEFT), ("right", _RIGHT))
}
_SEPARATORS = "_-. "


def side_of(name: str) -> str | None:
    """ "left" or "right" if the name holds a word for exactly one side, such as ``left``, ``LC16``
    or ``cam0``.
    """
    found = [side for side, words in _SIDE_WORDS.items() if words.search(name)]
    return found[0] if len(found) == 1 else None


def stem_keys(lefts: Sequence[Path], rights: Sequence[Path]) -> tuple[Keys, Keys]:
    """The stems as they are (``0001.png`` and ``0001.tif``)."""
    return _grouped(lefts, lambda stem: stem), _grouped(rights, lambda stem: stem)


def side_keys(lefts: Sequence[Path], rights: Sequence[Path]) -> tuple[Keys, Keys]:
    """The stems without the word for their side (``left_0001`` and ``right_0001``)."""
    return _grouped(lefts, lambda stem: without_side(stem, "left")), _grouped(
        rights, lambda stem: without_side(stem, "right")
    )


def affix_keys(lefts: Sequence[Path], rights: Sequence[Path]) -> tuple[Keys, Keys]:
    """The stems without the letters that all files of their folder begin or end with (``fwd_0001``
    and ``aft_0001``).
    """
    return _within_affixes(lefts), _within_affixes(rights)


def number_pairs(lefts: Sequence[Path], rights: Sequence[Path]) -> list[tuple[Path, Path]]:
    """The files in the order of their numbers, where those of both sides differ by a constant
    (``DSC_4711``, ``DSC_0523``), also where a camera's counter starts again, in a folder (9999,
    then 1) or with a new one (``100MEDIA/DJI_0999``, ``101MEDIA/DJI_0001``).

    None at all unless both sides have as many files, of which all numbers differ by that constant:
    no image is missing then.
    """
    counted = [_counted(side) for side in (lefts, rights)]
    if (
        len(lefts) < 2
        or {len(side) for side in counted} != {len(lefts)}
        or len(lefts) != len(rights)
    ):
        return []
    both = list(zip(*(sorted(side.items()) for side in counted), strict=True))
    if len({right - left for (left, _), (right, _) in both}) > 1:
        return []
    return [(left, right) for (_, left), (_, right) in both]


def _counted(paths: Sequence[Path]) -> dict[int, Path]:
    """Files by the number that a counter would have that never starts again; none where a file has
    no number.
    """
    found = {path: re.search(r"(?<!\d)\d+$", path.stem) for path in paths}
    numbers = {path: int(digits[0]) for path, digits in found.items() if digits}
    if len(numbers) < len(paths):
        return {}
    counted: dict[int, Path] = {}
    before, offset = -1, 0
    for folder in sorted({path.parent for path in paths}, key=lambda one: natural_key(str(one))):
        own = sorted((number, path) for path, number in numbers.items() if path.parent == folder)
        for number, path in _unrolled(own, len(found[own[-1][1]][0])):  # type: ignore[index]
            if number + offset <= before:
                offset = before + 1 - number
            before = number + offset
            counted[before] = path
    return counted


def _unrolled(own: list[tuple[int, Path]], digits: int) -> list[tuple[int, Path]]:
    """The sorted files of a folder, the ones after 9999 last."""
    steps = [after - before for (before, _), (after, _) in pairwise(own)]
    rolled = own[0][0] <= 1 and own[-1][0] == 10**digits - 1
    if not rolled or max(steps, default=0) <= 1:
        return own
    turn = steps.index(max(steps)) + 1
    return [*own[turn:], *own[:turn]]


def _grouped(paths: Sequence[Path], key_of: Callable[[str], str]) -> Keys:
    keys: Keys = defaultdict(list)
    for path in paths:
        keys[key_of(path.stem)].append(path)
    return keys


def without_side(stem: str, side: str) -> str:
    """A name without the word for its side, "left" or "right"; the name itself where nothing else
    is in it.
    """
    rest = _SIDE_WORDS[side].sub("", stem)
    return re.sub(r"([_\-. ])[_\-. ]+", r"\1", rest).strip(_SEPARATORS) or stem


def _within_affixes(paths: Sequence[Path]) -> Keys:
    prefix = _common_prefix([path.stem for path in paths])
    suffix = _common_prefix([path.stem[len(prefix) :][::-1] for path in paths])
    return _grouped(
        paths, lambda stem: stem[len(prefix) : len(stem) - len(suffix)].strip(_SEPARATORS) or stem
    )


def _common_prefix(texts: Sequence[str]) -> str:
    """What all texts begin with, less the digits at its end, which are the beginning of a number;
    of one text, its letters.
    """
    first, last = min(texts), max(texts)
    if first == last:
        return re.match(r"\D*", first)[0]  # type: ignore[index]  # matches anything
    length = next(
        (i for i, (a, b) in enumerate(zip(first, last, strict=False)) if a != b),
        min(len(first), len(last)),
    )
    return re.sub(r"(?<!\d)\d+$", "", first[:length])


# Time stamps as vehicles write them into file names.

_SECONDS_NANOSECONDS = re.compile(
    r"(?<!\d)(\d{10})[-_.](\d{6,10})(?!\d)|(?<!\d)(1\d{9})\.(\d{1,5})(?!\d)"
)
_EPOCH = re.compile(r"(?<!\d)(\d{19}|1[0-7]\d{15}|\d{16}|\d{13})(?!\d)")
_CALENDAR = re.compile(
    r"(?<!\d)(\d{4})-?(\d\d)-?(\d\d)[T_ "
    r".-]?(\d\d)[-:_.]?(\d\d)[-:_.]?(\d\d)(?:[._-]?(\d{1,9}))?(?!\d)"
)
_EPOCH_UNITS = {19: 1e9, 17: 1e7, 16: 1e6, 13: 1e3}


def timestamp_from_name(stem: str) -> float | None:
    """Seconds since 1970 from a file name's stem, None where it holds no time.

    Understood: seconds and fraction (``1317354879.544786``, ``1659471354-0395682455``,
    ``1317354879.54``), epoch in ns, 0.1 us, us or ms by its number of digits, and calendar time in
    UTC (``20180811_153729_762``, ``2022-08-01T12-34-56.250``).
    """
    if match := _SECONDS_NANOSECONDS.search(stem):
        seconds, fraction = (part for part in match.groups() if part is not None)
        # ten digits after a dash are nanoseconds with a leading zero, as ROS bags' extractors write
        # them
        return int(seconds) + (
            int(fraction) / 1e9 if len(fraction) == 10 else int(fraction) / 10 ** len(fraction)
        )
    if match := _EPOCH.search(stem):
        return int(match[1]) / _EPOCH_UNITS[len(match[1])]
    if match := _CALENDAR.search(stem):
        *calendar, fraction = match.groups()
        try:
            moment = datetime(*(int(part) for part in calendar), tzinfo=UTC)  # type: ignore[misc, arg-type]
        except ValueError:
            return None
        return moment.timestamp() + (int(fraction) / 10 ** len(fraction) if fraction else 0.0)
    return None


# Time stamps in file names, and the distance to the nearest one of the other side.

FAR_S = 1.0
"""Files farther apart were not meant for each other."""


def timed(paths: Iterable[Path]) -> list[tuple[float, Path]]:
    """List the files with a time stamp, (seconds, path), in order of time."""
    return sorted((t, p) for p in paths if (t := timestamp_from_name(p.stem)) is not None)


def nearest(times: Sequence[float], time_s: float) -> int | None:
    """The index of the nearest of sorted times; None where there are none."""
    right = bisect_left(times, time_s)
    candidates = [i for i in (right - 1, right) if 0 <= i < len(times)]
    return min(candidates, key=lambda i: abs(times[i] - time_s), default=None)


def distances_s(paths: Iterable[Path], others: Iterable[Path]) -> dict[Path, float]:
    """Compute the seconds to the nearest of the others for each path with a time stamp, where that
    is less than FAR_S.
    """
    times = [time_s for time_s, _ in timed(others)]
    found = {
        path: abs(times[i] - time_s)
        for time_s, path in timed(paths)
        if (i := nearest(times, time_s)) is not None
    }
    return {path: off_s for path, off_s in found.items() if off_s < FAR_S}


# The constant difference between two cameras' clocks that were never synchronized, from their
# time stamps.

Array = NDArray[np.float64]


@dataclass(frozen=True)
class OffsetLimits:
    """When a difference is accepted.

    least_pairs: fewer fit some difference by chance. fitting: fraction of the images of the side
    that has fewer. more_tried: so many images may be missing at the start of either side, beside
    those that the other side has more. near: tolerances from a first difference, which one pair
    gives with its own error, within which others improve it.
    """

    least_pairs: int = 3
    fitting: float = 0.8
    more_tried: int = 3
    near: float = 5.0
    most_tried: int = 100


LIMITS = OffsetLimits()
DRIFT_PAIRS = 4
"""Pairs with two time stamps that are needed to speak of drift: the medians of the first and the
last quarter are compared.
"""

DRIFT_S = 1e-3
"""Movement of one clock against the other that is worth a note, seconds; less is the rounding of
milliseconds.
"""


def clock_offset_s(
    left_s: Sequence[float], right_s: Sequence[float], tolerance_s: float
) -> float | None:
    """Estimate how far the right clock is ahead of the left one, from all time stamps of both
    sides, sorted; None if no difference fits.

    The difference at which the most stamps have a partner within the tolerance. Of a steady rhythm
    several differences fit; that which leaves the fewest images without a partner is taken, and the
    images must confirm it.
    """
    left, right = np.asarray(left_s), np.asarray(right_s)
    fewer = min(left.size, right.size)
    if fewer < LIMITS.least_pairs:
        return None
    tried = min(abs(left.size - right.size) + LIMITS.more_tried, LIMITS.most_tried)
    by_one_pair = (*(right[:tried] - left[0]), *(right[0] - left[1:tried]))
    shifts = [_improved(left, right, shift, LIMITS.near * tolerance_s) for shift in by_one_pair]
    counts = [
        np.count_nonzero(np.abs(_to_nearest(left + shift, right)) <= tolerance_s)
        for shift in shifts
    ]
    best = int(np.argmax(counts))
    return None if counts[best] < max(LIMITS.least_pairs, LIMITS.fitting * fewer) else shifts[best]


def _improved(left: Array, right: Array, shift_s: float, near_s: float) -> float:
    off_s = _to_nearest(left + shift_s, right)
    return float(shift_s + np.median(off_s[np.abs(off_s) <= near_s]))


def _to_nearest(times_s: Array, others_s: Array) -> Array:
    """(n,) from each time to the nearest of the others, sorted; positive where that is later."""
    after = np.clip(np.searchsorted(others_s, times_s), 1, others_s.size - 1)
    before = others_s[after - 1] - times_s
    behind = others_s[after] - times_s
    return np.where(np.abs(before) < np.abs(behind), before, behind)


def drift_notes(offsets_s: Sequence[float]) -> tuple[str, ...]:
    """Say so if two cameras' clocks move against each other: the pairs that are still near enough
    are then few.

    offsets_s: what the right clock is ahead, of each pair in the order of the dive.
    """
    if len(offsets_s) < DRIFT_PAIRS:
        return ()
    quarter = len(offsets_s) // 4
    first, last = (
        sorted(offsets_s[:quarter])[quarter // 2],
        sorted(offsets_s[-quarter:])[quarter // 2],
    )
    if abs(last - first) < DRIFT_S:
        return ()
    return (
        f"the right clock moved by {1000 * (last - first):+.1f} ms against the left one from "
        "first to last pair",
    )
