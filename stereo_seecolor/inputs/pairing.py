"""Which file of the left folder belongs to which of the right one, and which belong to none."""

import os
import re
from bisect import bisect_left
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from stereo_seecolor.config import InputConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.images import EXTENSIONS
from stereo_seecolor.inputs.timestamps import timestamp_from_name

_SIDE = {
    "left": re.compile(r"(?<![a-z])(left|lc|l|cam0)(?![a-z])", re.IGNORECASE),
    "right": re.compile(r"(?<![a-z])(right|rc|r|cam1)(?![a-z])", re.IGNORECASE),
}
_SEPARATORS = "_-. "


@dataclass(frozen=True)
class Pair:
    """Two files that belong together. name: what the outputs are called. timestamp_s: from the left name, or None."""

    name: str
    left: Path
    right: Path
    timestamp_s: float | None = None


@dataclass(frozen=True)
class Unpaired:
    """A file that no partner was found for, and why."""

    path: Path
    reason: str


@dataclass(frozen=True)
class Pairing:
    """All pairs of two folders in the order of their names, and every file that is in none.

    notes: what a person should know of the pairing as a whole, such as two clocks that drift apart.
    """

    pairs: tuple[Pair, ...]
    unpaired: tuple[Unpaired, ...]
    notes: tuple[str, ...] = ()


def list_files(folder: Path, what: str) -> list[Path]:
    """The image files directly in ``folder``, sorted by name; hidden files are none of them.

    Raises InputError if the folder is missing, cannot be read, or holds no image.
    """
    try:
        with os.scandir(folder) as entries:
            names = sorted(e.name for e in entries if Path(e.name).suffix.lower() in EXTENSIONS and not e.name.startswith("."))
    except FileNotFoundError as error:
        raise InputError(f"{folder}: the folder of {what} does not exist") from error
    except NotADirectoryError as error:
        raise InputError(f"{folder}: is a file; give the folder of {what}") from error
    except OSError as error:
        raise InputError(f"{folder}: the folder of {what} cannot be read: {error.strerror}") from error
    if not names:
        raise InputError(f"{folder}: holds no {what} ({', '.join(sorted(EXTENSIONS))})")
    return [folder / name for name in names]


def pair_folders(left: Path, right: Path, config: InputConfig) -> Pairing:
    """Pair the images of two folders by name, by time stamp, or (auto) by name and then the rest by time stamp.

    Raises InputError if a folder is missing or empty, or if no pair is found.
    """
    lefts, rights = list_files(left, "left images"), list_files(right, "right images")
    pairs: list[Pair] = []
    unpaired: list[Unpaired] = []
    if config.pairing != "timestamp":
        pairs, lefts, rights, unpaired = _by_name(lefts, rights)
    if config.pairing != "name" and lefts and rights:
        timed, lefts, rights = _by_timestamp(lefts, rights, config.timestamp_tolerance_s)
        pairs += timed
    if not pairs:
        raise InputError(
            f"{left} and {right}: no left image matches a right one by name or time stamp, for example {(lefts or [left])[0].name} "
            f"and {(rights or [right])[0].name}: give both the same stem, or set input.timestamp_tolerance_s"
        )
    unpaired += [Unpaired(path, "no right image matches") for path in lefts]
    unpaired += [Unpaired(path, "no left image matches") for path in rights]
    pairs.sort(key=lambda pair: pair.name)
    return Pairing(tuple(pairs), tuple(sorted(unpaired, key=lambda u: u.path)), _drift_notes(pairs))


def pair_by_stem(images: Path, ranges: Path) -> Pairing:
    """Pair images with the range maps of the same stem, for people who bring their own; ``right`` is the range map."""
    pairs, lefts, rights, unpaired = _by_name(list_files(images, "images"), list_files(ranges, "range maps"))
    if not pairs:
        raise InputError(f"{images} and {ranges}: no image has a range map of the same name: {lefts[0].name} and {rights[0].name}")
    unpaired += [Unpaired(path, "no range map matches") for path in lefts]
    unpaired += [Unpaired(path, "no image matches") for path in rights]
    return Pairing(tuple(sorted(pairs, key=lambda pair: pair.name)), tuple(unpaired))


def _by_name(lefts: list[Path], rights: list[Path]) -> tuple[list[Pair], list[Path], list[Path], list[Unpaired]]:
    """Pairs whose stems agree once the side is taken out of them; then what is left of either folder."""
    left_keys, right_keys = _keys(lefts, "left"), _keys(rights, "right")
    if not left_keys.keys() & right_keys.keys():
        left_keys, right_keys = _keys_within_affixes(lefts), _keys_within_affixes(rights)
    pairs: list[Pair] = []
    unpaired: list[Unpaired] = []
    for key in left_keys.keys() & right_keys.keys():
        sides = left_keys.pop(key), right_keys.pop(key)
        if len(sides[0]) == len(sides[1]) == 1:
            (left,), (right,) = sides
            name = left.stem if left.stem == right.stem else key
            pairs.append(Pair(name, left, right, timestamp_from_name(left.stem)))
        else:
            unpaired += [
                Unpaired(path, f"several files are called {key!r}: which one is meant?") for side in sides for path in side
            ]
    return pairs, _flat(left_keys.values()), _flat(right_keys.values()), unpaired


def _keys(paths: list[Path], side: str) -> dict[str, list[Path]]:
    keys: dict[str, list[Path]] = defaultdict(list)
    for path in paths:
        without_side = _SIDE[side].sub("", path.stem)
        keys[re.sub(r"([_\-. ])[_\-. ]+", r"\1", without_side).strip(_SEPARATORS) or path.stem].append(path)
    return keys


def _keys_within_affixes(paths: list[Path]) -> dict[str, list[Path]]:
    """Stems without the letters that all files of the folder begin or end with (``fwd_0001`` and ``aft_0001``)."""
    prefix = _common_prefix([path.stem for path in paths])
    rests = [path.stem[len(prefix) :] for path in paths]
    suffix = _common_prefix([rest[::-1] for rest in rests])
    keys: dict[str, list[Path]] = defaultdict(list)
    for path, rest in zip(paths, rests, strict=True):
        keys[rest[: len(rest) - len(suffix)].strip(_SEPARATORS) or path.stem].append(path)
    return keys


def _common_prefix(texts: list[str]) -> str:
    """What all texts begin with, less the digits at its end, which are the beginning of a number; of one text, its letters."""
    first, last = min(texts), max(texts)
    if first == last:
        return re.match(r"\D*", first)[0]  # type: ignore[index]  # matches anything
    length = next((i for i, (a, b) in enumerate(zip(first, last, strict=False)) if a != b), min(len(first), len(last)))
    return re.sub(r"\d+$", "", first[:length])


def _by_timestamp(lefts: list[Path], rights: list[Path], tolerance_s: float) -> tuple[list[Pair], list[Path], list[Path]]:
    """Mutually nearest time stamps that differ by at most the tolerance."""
    timed_left = sorted((t, p) for p in lefts if (t := timestamp_from_name(p.stem)) is not None)
    timed_right = sorted((t, p) for p in rights if (t := timestamp_from_name(p.stem)) is not None)
    left_times, right_times = [t for t, _ in timed_left], [t for t, _ in timed_right]
    pairs = []
    for i, (time_s, left) in enumerate(timed_left):
        j = _nearest(right_times, time_s)
        if j is None or abs(right_times[j] - time_s) > tolerance_s or _nearest(left_times, right_times[j]) != i:
            continue
        pairs.append(Pair(left.stem, left, timed_right[j][1], time_s))
    paired = {pair.left for pair in pairs} | {pair.right for pair in pairs}
    return pairs, [p for p in lefts if p not in paired], [p for p in rights if p not in paired]


def _nearest(times: list[float], time_s: float) -> int | None:
    right = bisect_left(times, time_s)
    candidates = [i for i in (right - 1, right) if 0 <= i < len(times)]
    return min(candidates, key=lambda i: abs(times[i] - time_s), default=None)


def _drift_notes(pairs: list[Pair]) -> tuple[str, ...]:
    """Say so if the two cameras' clocks move against each other: the pairs that are still near enough are then few."""
    times = [(pair.timestamp_s, timestamp_from_name(pair.right.stem)) for pair in pairs]
    offsets = [right - left for left, right in times if left is not None and right is not None]
    if len(offsets) < 4:
        return ()
    quarter = len(offsets) // 4
    first, last = sorted(offsets[:quarter])[quarter // 2], sorted(offsets[-quarter:])[quarter // 2]
    if abs(last - first) < 1e-3:
        return ()
    return (f"the right clock moved by {1000 * (last - first):+.1f} ms against the left one from first to last pair",)


def _flat(groups: Iterable[list[Path]]) -> list[Path]:
    return [path for group in groups for path in group]
