"""Pairing: which left file belongs to which right one, and which files belong to none."""

from array import array
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf
from pathlib import Path

import numpy as np

from calibration.errors import counted
from calibration.rig_errors import RangeError
from stereo_seecolor.compute.packed import Packed
from stereo_seecolor.compute.sequences import Lazy
from stereo_seecolor.config import InputConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.names import natural_key, product_name, short_hash, stem_of
from stereo_seecolor.inputs.clock_offset import clock_offset_s, drift_notes
from stereo_seecolor.inputs.listing import (
    RANGE_EXTENSIONS,
    FolderFiles,
    Listing,
    Unpaired,
    list_images,
)
from stereo_seecolor.inputs.name_keys import (
    Keys,
    affix_keys,
    may_roll_over,
    names_after_rollover,
    number_pairs,
    numbered_apart,
    side_keys,
    stem_keys,
)
from stereo_seecolor.inputs.name_times import distances_s, nearest, timed, timestamp_from_name
from stereo_seecolor.records import Numbers

NO_PARTNER = "no {} image matches"
"""How the reason of a file begins for which the other side has none."""
SEVERAL = "several files are called"


@dataclass(frozen=True, slots=True)
class Pair:
    """Two files that belong together. name: of the outputs. timestamp_s: of the left name, or None.

    place: number in the dive, and its pairs: by these folders of outputs are cut.
    """

    name: str
    left: Path
    right: Path
    timestamp_s: float | None = None
    place: tuple[int, int] = field(default=(0, 1), compare=False)


def pair_of(name: str, left: Path, right: Path) -> Pair:
    """A pair of the time that the left file's name holds."""
    return Pair(product_name(name), left, right, timestamp_from_name(left.stem))


class DivePairs(Lazy[Pair]):
    """All pairs of a dive in order, perhaps a million, each with its number: packed without their
    paths, which take long to unpack.
    """

    def __init__(self) -> None:
        self._files: Packed[tuple[str, str, str, float | None]] = Packed()

    @classmethod
    def of(cls, pairs: Iterable[Pair]) -> "DivePairs":
        """Pack pairs in their order."""
        found = cls()
        for pair in pairs:
            found.add(pair.name, str(pair.left), str(pair.right), pair.timestamp_s)
        return found

    def add(self, name: str, left: str, right: str, timestamp_s: float | None) -> None:
        """Append a pair. Raises OutputError as ``Packed``."""
        self._files.append((name, left, right, timestamp_s))

    def __len__(self) -> int:
        return len(self._files)

    def __iter__(self) -> Iterator[Pair]:
        return map(self.item, range(len(self)))

    def item(self, number: int) -> Pair:
        """The pair of this number."""
        name, left, right, time_s = self._files.item(number)
        return Pair(name, Path(left), Path(right), time_s, (number, len(self)))

    @property
    def names(self) -> Iterator[str]:
        """The names of all pairs: ten times as fast as the pairs themselves."""
        return (name for name, *_ in self._files)


@dataclass(frozen=True)
class Pairing:
    """All pairs of two folders, by time where every name holds one, else in natural order; and
    every file without a partner.

    notes: what a person should know of the pairing as a whole, such as two clocks that drift apart.
    of_dive: number of pairs of the whole dive where these are a shard of it, else 0.
    missing_shards: shards of the dive whose pairs are not among these.
    wrong: numbers of the dive as a whole that are wrong, as notes say. ranges: the error of ranges
    as the check of the dive measured it, None where it could not. left_out: name of a pair that is
    not of the dive's rig -> why.
    """

    pairs: Sequence[Pair]
    unpaired: tuple[Unpaired, ...]
    notes: tuple[str, ...] = ()
    of_dive: int = 0
    missing_shards: tuple[str, ...] = ()
    wrong: frozenset[Numbers] = frozenset()
    ranges: RangeError | None = None
    left_out: Mapping[str, str] = field(default_factory=dict)

    @property
    def names(self) -> Iterator[str]:
        """The names of all pairs, in their order."""
        return (
            self.pairs.names
            if isinstance(self.pairs, DivePairs)
            else (pair.name for pair in self.pairs)
        )

    def with_notes(
        self, notes: tuple[str, ...], wrong: frozenset[Numbers] = frozenset()
    ) -> "Pairing":
        """Add notes, and what they say to be wrong."""
        return replace(self, notes=self.notes + notes, wrong=self.wrong | wrong)


@dataclass
class _Matching:
    """Files that wait for a partner, and what was found so far."""

    lefts: list[Path]
    rights: list[Path]
    pairs: list[Pair]
    unpaired: list[Unpaired]

    def settle(self, left_keys: Keys, right_keys: Keys) -> None:
        """Pair the files whose keys agree; where several share a key, none of them is."""
        for key in left_keys.keys() & right_keys.keys():
            lefts, rights = left_keys[key], right_keys[key]
            if len(lefts) == len(rights) == 1:
                name = lefts[0].stem if lefts[0].stem == rights[0].stem else key
                self.add(name, lefts[0], rights[0])
            else:
                several = sorted(lefts if len(lefts) > len(rights) else rights)
                names = ", ".join(path.name for path in several)
                example = f"{several[-1].parent.name}/*{several[-1].suffix}"
                reason = (
                    f"{SEVERAL} {key!r} ({names}): keep one of them, or name a pattern such "
                    f"as '{example}'"
                )
                self.unpaired += [Unpaired(path, reason) for path in (*lefts, *rights)]
        self.drop_settled()

    def add(self, name: str, left: Path, right: Path) -> None:
        """Add a pair."""
        self.pairs.append(pair_of(name, left, right))

    def settle_by_time(self, tolerance_s: float, offset_s: float = 0.0) -> None:
        """Pair nearest time stamps within the tolerance; the right clock is ahead by the offset."""
        lefts = timed(self.lefts)
        rights = [(time_s - offset_s, path) for time_s, path in timed(self.rights)]
        left_times, right_times = [t for t, _ in lefts], [t for t, _ in rights]
        for i, (time_s, left) in enumerate(lefts):
            j = nearest(right_times, time_s)
            if (
                j is not None
                and abs(right_times[j] - time_s) <= tolerance_s
                and nearest(left_times, right_times[j]) == i
            ):
                self.add(left.stem, left, rights[j][1])
        self.drop_settled()

    def say_how_far(self, tolerance_s: float) -> None:
        """Give files without a partner that have a time stamp the distance to the nearest file of
        the other side as the reason.
        """
        lefts = [pair.left for pair in self.pairs] + self.lefts
        rights = [pair.right for pair in self.pairs] + self.rights
        for side, alone, others in (("right", self.lefts, rights), ("left", self.rights, lefts)):
            for path, off_s in distances_s(alone, others).items():
                if off_s > tolerance_s:
                    how_far = (
                        f"the nearest in time is {off_s:.3f} s away, "
                        f"input.timestamp_tolerance_s is {tolerance_s:g}"
                    )
                    self.unpaired.append(Unpaired(path, f"{NO_PARTNER.format(side)}: {how_far}"))
        self.drop_settled()

    @property
    def ambiguous(self) -> str:
        """Why no file has a partner, where several share a name; else ""."""
        reasons = [file.reason for file in self.unpaired if file.reason.startswith(SEVERAL)]
        return min(reasons, default="") if not self.pairs else ""

    def drop_settled(self) -> None:
        """Leave only the files that wait for a partner."""
        settled = {path for pair in self.pairs for path in (pair.left, pair.right)} | {
            file.path for file in self.unpaired
        }
        self.lefts = [path for path in self.lefts if path not in settled]
        self.rights = [path for path in self.rights if path not in settled]


def pair_folders(left: Path, right: Path, config: InputConfig) -> Pairing:
    """Pair the images of two folders by name, by time stamp, or (auto) by name and then the rest by
    time stamp.

    left, right: as in list_images; two single images are a pair, whatever their names.
    Raises InputError if a folder is missing or empty, or if no pair is found.
    """
    lefts, rights = list_images(left, "left images"), list_images(right, "right images")
    same = None if config.pairing == "timestamp" else _same_stems(lefts.files, rights.files)
    if same is not None:
        return Pairing(same, _in_order([*lefts.unreadable, *rights.unreadable]))
    matching = _matching(lefts, rights)
    _settle_single(matching, left, right)
    return _settled(matching, config, f"{left} and {right}")


def _same_stems(lefts: Sequence[Path], rights: Sequence[Path]) -> Sequence[Pair] | None:
    """The pairs of two folders that hold the same stems in the order of the dive: most do, and need
    no search for partners.

    None for others, and where a name comes twice. A million pairs take little time and memory here,
    since no path is made of them.
    """
    if (
        not isinstance(lefts, FolderFiles)
        or not isinstance(rights, FolderFiles)
        or len(lefts) != len(rights)
        or may_roll_over(stem_of(lefts.names[0]), stem_of(lefts.names[-1]))
    ):
        return None
    pairs, name_hashes = DivePairs(), array("q")
    # with the separator at the end
    left_folder, right_folder = (str(side.folder / "_")[:-1] for side in (lefts, rights))
    has_times = timestamp_from_name(stem_of(lefts.names[0])) is not None
    last_s, last_name = -inf, ""
    for left, right in zip(lefts.names, rights.names, strict=True):
        stem = stem_of(left)
        time_s, name = timestamp_from_name(stem), product_name(stem)
        if stem != stem_of(right) or (time_s is not None) != has_times:
            return None
        order_s = time_s or 0.0
        if order_s < last_s or (order_s == last_s and natural_key(name) <= natural_key(last_name)):
            return None
        name_hashes.append(hash(name.casefold()))
        pairs.add(name, left_folder + left, right_folder + right, time_s)
        last_s, last_name = order_s, name
    return pairs if len(np.unique(name_hashes)) == len(name_hashes) else None


def pair_files(
    lefts: Sequence[Path],
    rights: Sequence[Path],
    config: InputConfig,
    where: str,
    complete: bool = True,
) -> Pairing:
    """Pair files that are listed already, as ``pair_folders`` does. where: for messages. complete:
    False while more files may come, so that a missing partner does not mean another clock or
    counter. Raises InputError if no pair is found.
    """
    return _settled(_Matching(list(lefts), list(rights), [], []), config, where, complete)


def _settled(
    matching: _Matching, config: InputConfig, where: str, complete: bool = True
) -> Pairing:
    if config.pairing != "timestamp":
        _settle_by_name(matching)
    notes: tuple[str, ...] = ()
    if config.pairing != "name":
        matching.settle_by_time(config.timestamp_tolerance_s)
        if complete:
            notes = _settle_by_offset(matching, config.timestamp_tolerance_s)
    by_number = complete and not matching.pairs and config.pairing != "timestamp"
    by_counter = _settle_by_number(matching) if by_number else ()
    if matching.ambiguous:
        raise InputError(f"{where}: {matching.ambiguous}")
    if not matching.pairs:
        both = matching.lefts and matching.rights
        example = (
            f", for example {matching.lefts[0].name} and {matching.rights[0].name}" if both else ""
        )
        if complete and numbered_apart(matching.lefts, matching.rights):
            raise InputError(
                f"{where}: {len(matching.lefts)} left and {len(matching.rights)} right images are "
                "numbered by each camera on its own: such files are paired in their order only "
                f"where none is missing{example}: remove those without a partner, or give both "
                "files of a pair the same name"
            )
        off_s = sorted(distances_s(matching.lefts, matching.rights).values())
        apart = f" (time stamps are {off_s[len(off_s) // 2]:.3f} s apart, median)" if off_s else ""
        raise InputError(
            f"{where}: no left image matches a right one by name or time stamp{example}{apart}: "
            "give both files the same name, or set a larger input.timestamp_tolerance_s"
        )
    if not (notes or by_counter) and config.pairing != "name":
        matching.say_how_far(config.timestamp_tolerance_s)
    pairing = _pairing(
        matching,
        NO_PARTNER.format("right"),
        NO_PARTNER.format("left"),
        in_order=by_number,
        tolerance_s=inf if notes else config.timestamp_tolerance_s,
    )
    return pairing.with_notes((*notes, *by_counter))


def _settle_by_offset(matching: _Matching, tolerance_s: float) -> tuple[str, ...]:
    """Where nothing else paired, by clocks that differ by a constant."""
    if matching.pairs:
        return ()
    lefts, rights = (
        [time_s for time_s, _ in timed(side)] for side in (matching.lefts, matching.rights)
    )
    offset_s = clock_offset_s(lefts, rights, tolerance_s)
    if offset_s is None:
        return ()
    matching.settle_by_time(tolerance_s, offset_s)
    ahead = f"{abs(offset_s):.3f} s {'ahead of' if offset_s > 0 else 'behind'}"
    found = (
        f"{counted(len(matching.pairs), 'pair')} of {len(lefts)} left and {len(rights)} right "
        "images"
    )
    return (f"the right clock is {ahead} the left one: {found} were paired with this offset",)


def _settle_by_number(matching: _Matching) -> tuple[str, ...]:
    """Where nothing else paired, by numbers with a constant difference."""
    for left, right in number_pairs(matching.lefts, matching.rights):
        matching.add(left.stem, left, right)
    matching.drop_settled()
    if not matching.pairs:
        return ()
    first = matching.pairs[0]
    found = (
        f"no names match: {counted(len(matching.pairs), 'pair')} were paired by the order of "
        "their numbers"
    )
    return (f"{found}, from {first.left.name} with {first.right.name} on",)


def pair_by_stem(images: Path, ranges: Path) -> Pairing:
    """Pair images with the user's range maps of the same stem; ``right`` is the range map."""
    matching = _matching(
        list_images(images, "images"), list_images(ranges, "range maps", RANGE_EXTENSIONS)
    )
    example = f"{matching.lefts[0].name} and {matching.rights[0].name}"
    _settle_single(matching, images, ranges)
    _settle_by_name(matching)
    if matching.ambiguous:
        raise InputError(f"{images} and {ranges}: {matching.ambiguous}")
    if not matching.pairs:
        raise InputError(
            f"{images} and {ranges}: no image has a range map of the same name, for example "
            f"{example}"
        )
    return _pairing(matching, "no range map matches", "no image matches")


def in_dive_order(pairs: Sequence[Pair]) -> list[Pair]:
    """Sort by time where every name holds one, else in natural order of the names, those after a
    counter's last number behind it.
    """
    have_times = all(pair.timestamp_s is not None for pair in pairs)
    ordered = sorted(
        pairs,
        key=lambda pair: (pair.timestamp_s or 0.0 if have_times else 0.0, natural_key(pair.name)),
    )
    after = 0 if have_times else names_after_rollover([pair.name for pair in ordered])
    return [*ordered[after:], *ordered[:after]]


def _matching(lefts: Listing, rights: Listing) -> _Matching:
    return _Matching(
        list(lefts.files), list(rights.files), [], [*lefts.unreadable, *rights.unreadable]
    )


def _settle_single(matching: _Matching, left: Path, right: Path) -> None:
    """One image a side, given by name or pattern, is a pair whatever the names are."""
    if (
        len(matching.lefts) == len(matching.rights) == 1
        and not left.is_dir()
        and not right.is_dir()
    ):
        matching.add(matching.lefts[0].stem, matching.lefts[0], matching.rights[0])
        matching.drop_settled()


def _settle_by_name(matching: _Matching) -> None:
    """Names that agree as they are; then without the word for the side; only if none do, without
    what the folder has in common.
    """
    for keys in (stem_keys, side_keys):
        matching.settle(*keys(matching.lefts, matching.rights))
    if not matching.pairs and matching.lefts and matching.rights:
        matching.settle(*affix_keys(matching.lefts, matching.rights))


def _pairing(
    matching: _Matching,
    left_reason: str,
    right_reason: str,
    in_order: bool = False,
    tolerance_s: float = inf,
) -> Pairing:
    """in_order: the pairs are in the dive's order already, which their names do not tell.
    tolerance_s: times in the names of a pair may lie so far apart without a note.
    """
    unpaired = [*matching.unpaired, *(Unpaired(path, left_reason) for path in matching.lefts)]
    unpaired += [Unpaired(path, right_reason) for path in matching.rights]
    pairs = with_unique_names(matching.pairs)
    pairs = pairs if in_order else in_dive_order(pairs)
    offsets_s = _offsets_s(pairs)
    notes = *drift_notes(offsets_s), *_apart_notes(offsets_s, tolerance_s)
    return Pairing(DivePairs.of(pairs), _in_order(unpaired), notes)


def _in_order(unpaired: list[Unpaired]) -> tuple[Unpaired, ...]:
    return tuple(
        sorted(unpaired, key=lambda file: (str(file.path.parent), natural_key(file.path.name)))
    )


def with_unique_names(
    pairs: list[Pair], file: Callable[[Path], str] = lambda path: path.name
) -> list[Pair]:
    """Append a hash of what ``file`` says of the left file to names that would meet in one output
    file, also where case does not count.
    """
    count = Counter(pair.name.casefold() for pair in pairs)
    return [
        pair
        if count[pair.name.casefold()] == 1
        else replace(pair, name=f"{pair.name}~{short_hash(file(pair.left))}")
        for pair in pairs
    ]


def _apart_notes(offsets_s: Sequence[float], tolerance_s: float) -> tuple[str, ...]:
    """A note where times in the names contradict the pairs."""
    apart_s = float(np.median(offsets_s)) if offsets_s else 0.0
    if abs(apart_s) <= tolerance_s:
        return ()
    return (
        f"the times in the names of both files of a pair lie {abs(apart_s):.3f} s apart (median): "
        "they were paired by the rest of their names; to pair them by time, set "
        "input.pairing=timestamp",
    )


def _offsets_s(pairs: Sequence[Pair]) -> Sequence[float]:
    """What the right clock is ahead, of the pairs whose names hold both times."""
    times = (
        (pair.timestamp_s, timestamp_from_name(pair.right.stem))
        for pair in pairs
        if pair.timestamp_s is not None
    )
    return array(
        "d", (right - left for left, right in times if left is not None and right is not None)
    )
