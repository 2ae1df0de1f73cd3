"""Pairs of a dive that do not fit one rigid rig: changes of the rig, pairs of another rig, and
images that move from frame to frame.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from calibration import CalibrationError, Rectification, StereoRig
from calibration.rectification import plan_rectification, raw_points
from calibration.verification.causes import find_causes
from calibration.verification.changes import (
    Changes,
    PairRows,
    changes_of,
    differ,
    enlarged_side,
    pair_rows,
)
from calibration.verification.matches import QUICK, Matches, find_matches, rectified_matches
from calibration.verification.motion import couple_across
from stereo_seecolor.checks.neighbors import constant_shift
from stereo_seecolor.checks.sample import (
    DECIDING_PAIRS,
    consecutive_intervals,
    edge,
    evenly_spaced,
    matching_threads,
    read_both,
    readable,
)
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


AROUND = 5
"""Pairs on either side with which a measured pair is compared."""
LEAST_OFF = {"coverage": 0.02, "median_range_m": 0.03, "vertical_px": 0.2}
"""Deviations that are usual in any dive: fraction, logarithm, pixels."""
STANDS_OUT = 4.0
"""Of these, or of the usual deviations of a dive, from which on a pair has a look."""
MOST_SUSPECTS = 8
"""Pairs that have one: each takes an eighth of a full check."""
MOST_LEFT = 0.5
"""Fraction of what pairs differ by that a fault which they share may leave when it is undone."""
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
    """Describe a pair by a quick look at its rows; None where it cannot be read or shows too
    little.
    """
    matches = _look(rectification, pair, images)
    return pair_rows(matches, rectification.matching_pair) if matches else None


def _look(rectification: Rectification, pair: Pair, images: InputConfig) -> Matches | None:
    with suppress(InputError, CalibrationError):
        return find_matches(rectification, *read_both(pair, images), QUICK)
    return None


def _rows_of(rectification: Rectification, both: tuple[Image, Image]) -> PairRows | None:
    matches = find_matches(rectification, *both, QUICK)
    return pair_rows(matches, rectification.matching_pair)


def find_change(
    rig: StereoRig,
    rectification: Rectification,
    pairs: Sequence[Pair],
    images: InputConfig,
    known: Sequence[tuple[Pair, Matches]] = (),
) -> DiveChange:
    """Compare pairs spread over a dive, and look for the first and the last one that changed, and
    for those that EXIF turns otherwise than the others.

    rectification: of the rig.
    known: pairs whose matches in the images that are matched are known; else COMPARED pairs have a
    quick look.
    """
    line, turned = turned_pairs(pairs, images, lambda both: _rows_of(rectification, both))
    if not turned:
        return _find_change(rig, rectification, pairs, images, known)
    others = [(pair, matches) for pair, matches in known if pair.name not in turned]
    change = _find_change(
        rig, rectification, [pair for pair in pairs if pair.name not in turned], images, others
    )
    lines = "; ".join(filter(None, (line, change.line)))
    return replace(change, line=lines, odd=change.odd | turned)


def _find_change(
    rig: StereoRig,
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
        threads = matching_threads(rectification.raw_size)
        rows = list(threads.each(lambda pair: look_at(rectification, pair, images), sample))
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
                return DiveChange(_exchanged_line(wrong[0].name, wrong[-1].name), names)
        side = _side(rectification, pairs, first, changes, images)
        return DiveChange(_step_line(pairs, first, changes, side), is_rigid=False)
    if changes.kind == "drift":
        return DiveChange(_drift_line(pairs, changes), is_rigid=False)
    if changes.kind == "each":
        chosen = evenly_spaced(pairs, DECIDING_PAIRS + 2)[1:-1]
        shift = constant_shift(chosen, pairs, rectification, images)
        line = shift or _each_line(pairs, changes)
        return DiveChange(line, is_rigid=False, out_of_step=shift is not None)
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
            _exchanged_line(pairs[first].name, pairs[last].name)
            if _are_exchanged(rectification, pairs[first], images, reference)
            else odd_line(pairs[first].name, pairs[last].name)
            for first, last in parts
        ]
        odd = {pairs[i].name for first, last in parts for i in range(first, last + 1)}
        return DiveChange("; ".join(lines), frozenset(odd))
    return DiveChange()


def _are_alike_undone(rig: StereoRig, seen: Sequence[Matches | None]) -> bool:
    """Tell whether pairs no longer differ once the fault that explains them together is undone: a
    large one moves rows by other amounts where the scene is near and where it is far.
    """
    found = [matches for matches in seen if matches]
    causes = find_causes(rig, found)
    if not causes.explains or causes.rig is None:
        return False
    raw = [Matches(*raw_points(rig, one.left, one.right)) for one in found]
    as_given, undone = (
        [pair_rows(one, plan_rectification(by).matching_pair) for one in rectified_matches(by, raw)]
        for by in (rig, causes.rig)
    )
    less = _spread_px(undone) < MOST_LEFT * _spread_px(as_given)
    return less and not changes_of(undone).kind


def _spread_px(rows: Sequence[PairRows | None]) -> float:
    motions = np.array([one.motion_px for one in rows if one])
    return float(np.linalg.norm(motions.std(axis=0))) if len(motions) else float("inf")


def odd_among(
    rectification: Rectification,
    pairs: Sequence[Pair],
    images: InputConfig,
    facts: Sequence[Mapping[str, float]],
) -> DiveChange:
    """Look at the pairs of a dive that was measured whose numbers stand out, and at some that do
    not. facts: of each pair (``dive.frames.range_facts``).

    Single odd pairs of a long dive are not among those that ``find_change`` compares.
    """
    suspects = _standing_out(facts)
    if not suspects:
        return DiveChange()
    usual = [place for place in range(len(pairs)) if place not in suspects]
    compared = sorted({*suspects, *evenly_spaced(usual, 2 * len(suspects) + 2)})
    threads = matching_threads(rectification.raw_size)
    rows = list(threads.each(lambda place: look_at(rectification, pairs[place], images), compared))
    changes = changes_of(rows)
    odd = [compared[number] for number in changes.odd if compared[number] in suspects]
    lines = [
        odd_line(pairs[first].name, pairs[last].name) for first, last in consecutive_intervals(odd)
    ]
    return DiveChange("; ".join(lines), frozenset(pairs[place].name for place in odd))


def _standing_out(facts: Sequence[Mapping[str, float]]) -> list[int]:
    """Places of the pairs, MOST_SUSPECTS at most, whose numbers differ the most from those of the
    pairs around them.
    """
    far = np.zeros(len(facts))
    for name in ("coverage", "median_range_m", "vertical_px"):
        unknown = 0.0 if name == "vertical_px" else np.nan
        values = np.array([one.get(name, unknown) for one in facts])
        values = np.log(values) if name == "median_range_m" else values
        around = np.array(
            [np.nanmedian(values[max(0, i - AROUND) : i + AROUND + 1]) for i in range(len(values))]
            if np.isfinite(values).any()
            else values
        )
        off = np.abs(values - around)
        usual = 1.4826 * float(np.nanmedian(off)) if np.isfinite(off).any() else 0.0
        far = np.fmax(far, off / max(usual, LEAST_OFF[name]))
    most = np.argsort(far)[::-1][:MOST_SUSPECTS]
    return sorted(int(place) for place in most if far[place] > STANDS_OUT)


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


def _exchanged_line(first: str, last: str) -> str:
    return (
        f"{_named(first, last)}: left and right are exchanged: their rows fit the rig of the "
        "other pairs only with both sides exchanged: exchange the files of these pairs"
    )


def _named(first: str, last: str) -> str:
    return first if first == last else f"from {first} to {last}"


def _side(
    rectification: Rectification,
    pairs: Sequence[Pair],
    first: int,
    changes: Changes,
    images: InputConfig,
) -> str:
    """The side whose lens changed at the pair ``first``; "" where that is not seen, or no lens
    did.
    """
    if changes.scale != changes.scale:  # NaN
        return ""
    after = [pairs[first + step] for step in AFTER if first + step < len(pairs)]
    couples = [
        couple_across(rectification, (both for _, both in readable([before, *after], images)))
        for before in pairs[max(0, first - COUPLES) : first]
    ]
    seen = [couple for couple in couples if couple]
    return enlarged_side(seen, rectification.matching_pair, changes.scale)


def _step_line(pairs: Sequence[Pair], first: int, changes: Changes, side: str) -> str:
    here = pairs[first].name
    if changes.scale == changes.scale:
        larger = changes.scale - 1
        what = {
            "right": f"the right images are {_percent(larger)} than before",
            "left": f"the left images are {_percent(1 / changes.scale - 1)} than before",
            "": f"the right images are {_percent(larger)} than before, or the left ones "
            f"{_percent(1 / changes.scale - 1)}; the motion does not show which",
        }[side]
        cause = "the rows fit this, but no offset or roll: focus or zoom of a lens changed"
    else:
        what = (
            "the rows of the right images have moved relative to the left ones, by "
            f"{changes.spread_px:.1f} px (root mean square over the image)"
        )
        cause = (
            "an offset or a roll, but no enlargement and no exchange of sides, explains this: a "
            "camera was knocked or mounted again, images are cropped differently, or pairs come "
            "from another rig from there"
        )
    return (
        f"from {here} on {what}: {cause}: ranges on one side of {here} are wrong by about "
        f"{changes.range_error:.0%}: process both parts separately, each with its own "
        "calibration"
    )


def _percent(larger: float) -> str:
    return f"{abs(larger):.1%} {'larger' if larger > 0 else 'smaller'}"


def _drift_line(pairs: Sequence[Pair], changes: Changes) -> str:
    return (
        f"rows of the right images move steadily relative to the left ones, from {pairs[0].name} "
        f"to {pairs[-1].name}, by {changes.spread_px:.1f} px (root mean square over the image): a "
        "camera turns slowly in its mount, or a lens changes with temperature: if columns move "
        f"like rows, ranges at one end of the dive are wrong by about {changes.range_error:.0%}: "
        "process the dive in parts, each with run --refine or its own calibration"
    )


def _each_line(pairs: Sequence[Pair], changes: Changes) -> str:
    where = f"from {pairs[0].name} to {pairs[-1].name}"
    amount = (
        f"rows of the right images change from frame to frame, {where}, by "
        f"{changes.spread_px:.1f} px (standard deviation)"
    )
    if changes.moments:
        cause = (
            "near and far points move by different amounts: the sides were not exposed at the "
            "same moment, or one moving camera took both"
        )
    elif changes.scale == changes.scale:
        cause = (
            "an enlargement of one side explains this, but no offset or roll: focus or zoom of a "
            "lens changes (autofocus)"
        )
    else:
        cause = (
            "a different offset and roll for each pair explain this, and near and far points "
            "move equally: stabilization of one or both sides, or a loose camera; sides "
            "exposed at different moments while the cameras rotate would look the same"
        )
    return (
        f"{amount}: {cause}: if columns move like rows, ranges are wrong by about "
        f"{changes.range_error:.0%}, by a different amount in each frame: record without "
        "stabilization and with fixed focus, and trigger both cameras together"
    )


def odd_line(first: str, last: str) -> str:
    """The line for pairs that are not of the rig of the others: the first and the last of them."""
    return (
        f"{_named(first, last)}: their rows do not fit the rig of the other pairs, exchanged or "
        "not: they come from another rig or dive, or their sides were not exposed at the "
        "same moment: not used for the refined rig, the light and the water; remove them, or "
        "process them separately"
    )
