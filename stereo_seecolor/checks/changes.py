"""Pairs of a dive that do not fit one rigid rig: changes of the rig, pairs of another rig, and
images that move from frame to frame.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

from calibration import CalibrationError, Rectification
from calibration.verification.changes import (
    Changes,
    PairRows,
    changes_of,
    differ,
    enlarged_side,
    pair_rows,
)
from calibration.verification.matches import MATCH_LIMITS, QUICK, Matches, find_matches
from calibration.verification.motion import couple_of
from stereo_seecolor.checks.change_texts import (
    drift_line,
    each_line,
    exchanged_line,
    odd_line,
    shifted_line,
    step_line,
)
from stereo_seecolor.checks.neighbors import constant_shift, neighbor_that_fits
from stereo_seecolor.checks.sample import edge, evenly_spaced, matching_threads, read_both, readable
from stereo_seecolor.checks.turned import turned_pairs
from stereo_seecolor.config import InputConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.records import Image

COMPARED = 12
"""Pairs, spread over the dive, that are compared."""
AFTER = (0, 1, 2, 4, 8)
"""Pairs after a change, counted from its first one, that are tried for a couple with one before:
frames of a video move little."""
COUPLES = 3
"""Pairs before a change that are tried."""
LEAST_SLIP = 5
"""Of the last pairs so many are looked at, at least, for sides that are out of step there."""


LEFT_OUT = "does not fit the rig of the other pairs, and is left out (see the note)"
"""Why a pair fails that does not fit the rig of the dive."""


@dataclass(frozen=True)
class DiveChange:
    """What changes within a dive. line: what, where, and what to do; "" where nothing does.

    odd: names of pairs that are not of the rig of the others. is_rigid: False where no one rig took
    the other pairs. out_of_step: the sides are, alike in all pairs.
    """

    line: str = ""
    odd: frozenset[str] = frozenset()
    is_rigid: bool = True
    out_of_step: bool = False

    def shared(self, pairs: Sequence[Pair]) -> Sequence[Pair]:
        """The pairs that are not odd."""
        return [pair for pair in pairs if pair.name not in self.odd] if self.odd else pairs


def look_at(rectification: Rectification, pair: Pair, images: InputConfig) -> PairRows | None:
    """Describe a pair by a quick look at its rows; None if unreadable or too poor."""
    with suppress(InputError, CalibrationError):
        return _rows_of(rectification, read_both(pair, images))
    return None


def look_at_all(
    rectification: Rectification, pairs: Sequence[Pair], images: InputConfig
) -> list[PairRows | None]:
    """``look_at`` each pair, on all cores."""
    threads = matching_threads(rectification.raw_size)
    return list(threads.each(lambda pair: look_at(rectification, pair, images), pairs))


def _rows_of(rectification: Rectification, both: tuple[Image, Image]) -> PairRows | None:
    matches = find_matches(rectification, *both, QUICK)
    return pair_rows(matches, rectification.matching_pair)


def find_change(
    rectification: Rectification,
    pairs: Sequence[Pair],
    images: InputConfig,
    known: Sequence[tuple[Pair, Matches]] = (),
) -> DiveChange:
    """Compare pairs spread over a dive, and look for the first and the last one that changed, and
    for those that EXIF turns otherwise than the others.

    known: pairs whose matches in the images that are matched are known; else COMPARED pairs have a
    quick look.
    """
    line, turned = turned_pairs(pairs, images, lambda both: _rows_of(rectification, both))
    if not turned:
        return _find_change(rectification, pairs, images, known)
    others = [(pair, matches) for pair, matches in known if pair.name not in turned]
    change = _find_change(
        rectification, [pair for pair in pairs if pair.name not in turned], images, others
    )
    lines = "; ".join(filter(None, (line, change.line)))
    return replace(change, line=lines, odd=change.odd | turned)


def _find_change(
    rectification: Rectification,
    pairs: Sequence[Pair],
    images: InputConfig,
    known: Sequence[tuple[Pair, Matches]],
) -> DiveChange:
    geometry = rectification.matching_pair
    if known:
        sample = [pair for pair, _ in known]
        rows = [pair_rows(matches, geometry) for _, matches in known]
    else:
        sample = evenly_spaced(pairs, COMPARED)
        rows = look_at_all(rectification, sample, images)
    places = [pairs.index(pair) for pair in sample]
    changes = changes_of(rows)

    def changed(place: int, reference: PairRows) -> bool:
        seen = look_at(rectification, pairs[place], images)
        return seen is not None and differ(seen, reference)

    if changes.kind == "step":
        before = rows[changes.before]
        assert before
        first = edge(places[changes.before], places[changes.first], lambda i: changed(i, before))
        after = look_at(rectification, pairs[first], images)
        wrong = pairs[:first] if before.is_behind else pairs[first:]
        if after and after.is_behind != before.is_behind:
            right = after if before.is_behind else before
            if _are_exchanged(rectification, wrong[0], images, right):
                names = frozenset(pair.name for pair in wrong)
                return DiveChange(exchanged_line(wrong[0].name, wrong[-1].name), names)
        side = _side(rectification, pairs, first, changes, images)
        return DiveChange(step_line(pairs, first, changes, side), is_rigid=False)
    if changes.kind == "drift":
        return DiveChange(drift_line(pairs, changes), is_rigid=False)
    if changes.kind == "each":
        shift = constant_shift(pairs, rectification, images)
        if not shift and (slip := _slip(rectification, pairs, images)):
            return slip
        line = shift or each_line(pairs, changes)
        return DiveChange(line, is_rigid=False, out_of_step=bool(shift))
    if changes.kind == "odd":
        good = [number for number, one in enumerate(rows) if one and number not in changes.odd]
        reference = rows[good[len(good) // 2]]
        assert reference
        parts = _odd_parts(
            [places[number] for number in changes.odd],
            [places[number] for number in good],
            len(pairs),
            lambda i: changed(i, reference),
        )
        lines = [
            _part_line(rectification, pairs[first : last + 1], images, reference)
            for first, last in parts
        ]
        odd = {pairs[i].name for first, last in parts for i in range(first, last + 1)}
        return DiveChange("; ".join(lines), frozenset(odd))
    return DiveChange()


def _slip(
    rectification: Rectification, pairs: Sequence[Pair], images: InputConfig
) -> DiveChange | None:
    """The pairs from a place on in which the sides are out of step, as after an image that one side
    lost; None where the last ones are not so.
    """
    last = pairs[-max(len(pairs) // 3, LEAST_SLIP) :]
    if not (shift := constant_shift(last, rectification, images)):
        return None

    def shift_at(place: int) -> int:
        with suppress(InputError, CalibrationError):
            other = neighbor_that_fits(pairs[place], pairs, rectification, images)
            return pairs.index(other) - place if other else 0
        return 0

    first = edge(0, len(pairs) - (len(last) + 1) // 2, lambda place: shift_at(place) != 0)
    # the first left images whose right ones are lost fit none
    slipped = pairs[first + min(shift_at(first), 0) :]
    line = shifted_line(slipped[0].name, slipped[-1].name, shift)
    return DiveChange(line, frozenset(pair.name for pair in slipped))


def _part_line(
    rectification: Rectification, part: Sequence[Pair], images: InputConfig, reference: PairRows
) -> str:
    """What is wrong with the pairs of a part that do not fit the rig of ``reference``."""
    first, last = part[0].name, part[-1].name
    if _are_exchanged(rectification, part[0], images, reference):
        return exchanged_line(first, last)
    if shift := constant_shift(part, rectification, images):
        return shifted_line(first, last, shift)
    return odd_line(first, last)


def _odd_parts(
    odd: Sequence[int], good: Sequence[int], pairs: int, is_odd: Callable[[int], bool]
) -> list[tuple[int, int]]:
    """The first and last pair of each part of odd ones. odd, good: places of compared pairs."""
    parts: list[tuple[int, int]] = []
    for here in odd:
        if parts and here <= parts[-1][1]:
            continue
        before = [place for place in good if place < here]
        after = [place for place in good if place > here]
        first = edge(before[-1], here, is_odd) if before else 0
        last = edge(after[0], here, is_odd) if after else pairs - 1
        parts.append((first, last))
    return parts


def _are_exchanged(
    rectification: Rectification, pair: Pair, images: InputConfig, reference: PairRows
) -> bool:
    """Tell whether a pair fits the rig of ``reference`` with its sides exchanged."""
    exchanged = replace(pair, left=pair.right, right=pair.left)
    seen = look_at(rectification, exchanged, images)
    return seen is not None and not differ(seen, reference)


def _side(
    rectification: Rectification,
    pairs: Sequence[Pair],
    first: int,
    changes: Changes,
    images: InputConfig,
) -> str:
    """The side whose lens changed at the pair ``first``; "" where none did, or it is not seen."""
    if changes.scale != changes.scale:  # NaN
        return ""
    after = [pairs[first + step] for step in AFTER if first + step < len(pairs)]
    couples = [
        couple_of(
            rectification, (both for _, both in readable([before, *after], images)), MATCH_LIMITS
        )
        for before in pairs[max(0, first - COUPLES) : first]
    ]
    seen = [couple for couple in couples if couple]
    return enlarged_side(seen, rectification.matching_pair, changes.scale)
