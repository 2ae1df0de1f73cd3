"""Keys of file names, under which the left and the right file of a pair meet."""

import re
from collections import defaultdict
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path

from stereo_seecolor.files.names import natural_key

Keys = dict[str, list[Path]]
"""Key -> the files of one folder that have it; more than one where the key is ambiguous."""

_CAMERA = "cam|cams|camera|cameras|image|images|img|imgs|im|eye|view|frame|frames"
_SHORT = "cam|img|im|frame"
"""What stands beside words for a side: ``leftcam``, ``imgL``; not so ``imager``."""
_LEFT = (
    f"left({_CAMERA})?|({_SHORT})l|lft|lc|lm|l|cam0|linke?|links|gauche|izquierda|sinistra|esquerda"
)
_RIGHT = (
    f"right({_CAMERA})?|({_SHORT})r|rgt|rc|rm|r|cam1|rechte?|rechts|droite?|derecha|destra|direita"
)
"""LC and RM: the left camera in color and the right one in monochrome, as on some rigs."""

_WHOLE = {"port": "left", "starboard": "right", "stbd": "right"}
"""Alone they are sides; in names of places (``Port Davey``) they are not."""

_LETTER = r"[^\W\d_]"
"""Of any alphabet: the r of récif is not a word."""

_SIDE_WORDS = {
    side: re.compile(f"(?<!{_LETTER})({words})(?!{_LETTER})", re.IGNORECASE)
    for side, words in (("left", _LEFT), ("right", _RIGHT))
}
_SEPARATORS = "_-. "


def side_of(name: str) -> str | None:
    """ "left" or "right" if the name holds a word for exactly one side, such as ``left``, ``LC16``
    or ``cam0``, or is ``port`` or ``starboard``.
    """
    if side := _WHOLE.get(name.lower()):
        return side
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
    """The stems without the letters that all begin or end with (``fwd_0001``, ``aft_0001``).

    What both sides begin with stays, after a word of the side too (``fwd_2026_0001``,
    ``aft_2026_0001``): a date is shared by all files of an hour, and not by those of the next.
    """
    prefixes = [_common_prefix([path.stem for path in paths]) for paths in (lefts, rights)]
    shared = prefixes[0] if prefixes[0] == prefixes[1] else _shared_end(*prefixes)
    own_left, own_right = (len(prefix) - len(shared) for prefix in prefixes)
    return _within_affixes(lefts, own_left), _within_affixes(rights, own_right)


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


def numbered_apart(lefts: Sequence[Path], rights: Sequence[Path]) -> bool:
    """Tell whether both sides are numbered, and one has more files than the other."""
    return len(lefts) != len(rights) and bool(_counted(lefts) and _counted(rights))


def _counted(paths: Sequence[Path]) -> dict[int, Path]:
    """Files by the number that a counter would have that never starts again; none where a file has
    no number.

    A counter starts again in each folder, or where numbers come twice with each name before them
    (``GX010123_0001``, ``GX020123_0001``).
    """
    found = {path: _counter(path.stem) for path in paths}
    if not all(digits for _, digits in found.values()):
        return {}
    groups: dict[str, list[tuple[int, Path]]] = defaultdict(list)
    for path, (_, digits) in found.items():
        groups[str(path.parent)].append((int(digits), path))
    for folder, files in list(groups.items()):
        if len({number for number, _ in files}) < len(files):
            del groups[folder]
            for number, path in files:
                groups[f"{folder}/{found[path][0]}"].append((number, path))
    counted: dict[int, Path] = {}
    before, offset = -1, 0
    for _, files in sorted(groups.items(), key=lambda group: natural_key(group[0])):
        own = sorted(files)
        for number, path in _unrolled(own, len(found[own[-1][1]][1])):
            if number + offset <= before:
                offset = before + 1 - number
            before = number + offset
            counted[before] = path
    return counted


def may_roll_over(first: str, last: str) -> bool:
    """Whether the first and last sorted names are a counter's two ends: 0 or 1, and 9999."""
    (name, low), (same, high) = _counter(first), _counter(last)
    if not (low and high) or name != same:
        return False
    return int(low) <= 1 and len(low) == len(high) and set(high) == {"9"}


def _counter(name: str) -> tuple[str, str]:
    """A name without the number of a counter at its end, and the number; "" where none."""
    found = re.search(r"(?<!\d)\d+$", name)
    return (name[: found.start()], found[0]) if found else (name, "")


def names_after_rollover(names: Sequence[str]) -> int:
    """How many of the first of sorted names a counter gave after its last number, in which alone
    they differ (``DSC_9999``, then ``DSC_0000``); 0 where none.
    """
    if len(names) < 2 or not may_roll_over(names[0], names[-1]):
        return 0
    ends = [_counter(name) for name in names]
    if any(not number or before != ends[0][0] for before, number in ends):
        return 0
    own = [(int(number), Path(name)) for (_, number), name in zip(ends, names, strict=True)]
    return own.index(_unrolled(own, len(ends[-1][1]))[0])


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
    """A name without the word for its side, "left" or "right"; the name if that is all."""
    rest = _SIDE_WORDS[side].sub("", stem)
    return re.sub(r"([_\-. ])[_\-. ]+", r"\1", rest).strip(_SEPARATORS) or stem


def _within_affixes(paths: Sequence[Path], own: int) -> Keys:
    """The files by their stems without so many first letters, and the end that all share."""
    suffix = _common_prefix([path.stem[own:][::-1] for path in paths])
    return _grouped(
        paths, lambda stem: stem[own : len(stem) - len(suffix)].strip(_SEPARATORS) or stem
    )


def _shared_end(first: str, second: str) -> str:
    """What two texts end with, from a separator on."""
    ends = (first[i:] for i, letter in enumerate(first) if letter in _SEPARATORS)
    return next(filter(second.endswith, ends), "")


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
