"""Checks of the calibration and of the range limits on pairs spread over a dive, before a run."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import chain, tee

from calibration import CalibrationError, Rectification, StereoRig
from calibration.checks import RowCheck, judge_matches
from calibration.rectification import plan_rectification
from calibration.verification.causes import find_causes
from calibration.verification.conventions import settle_matches
from calibration.verification.explanations import Causes
from calibration.verification.matches import Images, Matches, find_matches
from calibration.verification.mistakes import FoundMistake, likely_mistake, may_be_wrong
from calibration.verification.motion import (
    changes_in_time,
    couple_of,
    find_motion,
    motion_of,
)
from calibration.verification.motion_result import LIMITS
from calibration.verification.quick_check import quick_check
from calibration.verification.rigid_motion import SeenTwice
from stereo_seecolor.checks.changes import COMPARED, DiveChange, find_change
from stereo_seecolor.checks.focal_lengths import stated_of_sides
from stereo_seecolor.checks.neighbors import constant_shift
from stereo_seecolor.checks.range_limits import range_limits
from stereo_seecolor.checks.sample import (
    DECIDING_PAIRS,
    evenly_spaced,
    first_images,
    matching_threads,
    neighbors,
    read_both,
    readable,
)
from stereo_seecolor.checks.verdict import NOTHING_FOUND, RANGES, DiveVerdict
from stereo_seecolor.config import InputConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.pipeline import Pipeline

PARTED_AT = (1 / 2, 1 / 4, 3 / 4)
"""Of a dive, where something may have changed that rows do not show."""
LEAST_PAIRS = 3
"""Of a part that is explained by itself."""
LOOKED_AT = 4
"""Pairs, spread over the dive, that have a quick look: a descent may last a quarter of a dive, and
a camera may be knocked.
"""


def check_rig(pipeline: Pipeline, pairs: Sequence[Pair], change: DiveChange) -> DiveVerdict:
    """Check rows and motion as ``check`` does, and features against the limits of range, on pairs
    spread over the dive.

    A quick look is enough for most dives. A full check takes longer than matching some pairs and is
    made only where rows of a pair disagree or may show wrong ranges. change: what changes from pair
    to pair. Raises InputError where no pair can be matched and the likely mistake is known.
    """
    pairs = change.shared(pairs)
    said = (f"calibration: {change.line}",) if change.line and change.is_rigid else ()
    # of pairs that are not as large as calibrated: the run names them
    with suppress(CalibrationError):
        seen = readable(evenly_spaced(pairs, LOOKED_AT), pipeline.config.input)
        threads = matching_threads(pipeline.rectification.raw_size)
        checked = threads.each(
            lambda one: (one[0], quick_check(pipeline.rectification, one[1])), seen
        )
        looks = [(pair, look) for pair, look in checked if look.range_m.size]
        if change.is_rigid and looks and all(look.rows_agree for _, look in looks):
            pair, first = looks[0]
            limits = range_limits(first.range_m, pipeline.config.matching)
            said = (*(f"range: in pair {pair.name}, {limit.note}" for limit in limits), *said)
            matches = [look.matches for _, look in looks]
            if not find_causes(pipeline.rig, matches).is_wrong:
                return _motion_check(pipeline, pairs, matches).after(DiveVerdict(said))
    return _full_check(pipeline, pairs, change).after(DiveVerdict(said))


def check_processed(pipeline: Pipeline, pairs: Sequence[Pair]) -> DiveVerdict:
    """``check_rig`` of pairs that were processed without it: what it would have refused or left out
    is wrong.
    """
    change = find_change(pipeline.rectification, pairs, pipeline.config.input)
    try:
        found = check_rig(pipeline, pairs, change)
    except InputError as error:
        return DiveVerdict((f"calibration: {error}",), RANGES)
    return replace(found, wrong=found.wrong | RANGES) if change.odd else found


def _motion_check(
    pipeline: Pipeline, pairs: Sequence[Pair], matches: Sequence[Matches]
) -> DiveVerdict:
    """What the motion shows, or it and rows do together where it leaves ranges open, and rows do
    not; of a refined rig, which rows were made to fit, also that it shows nothing.
    """
    starts = list(neighbors(pairs, pipeline.config.input))
    from_ends = [*starts[::2], *starts[1::2]]  # first, middle and last, then what lies between
    enough, rectification = LIMITS.least_couples, pipeline.rectification
    couples, again = tee(
        chain.from_iterable(
            _couples(rectification, some) for some in (from_ends[:enough], from_ends[enough:])
        )
    )
    motion = find_motion(couples, rectification.matching_pair)
    if motion.is_found or (
        not motion.is_right and find_causes(pipeline.rig, matches, list(again)).is_wrong
    ):
        return _full_check(pipeline, pairs, DiveChange())
    unseen = motion.is_misfit or (pipeline.config.input.refine and not motion.is_known)
    notes = (f"calibration: {motion.line}",) if unseen else ()
    return DiveVerdict(notes, measured=motion.measured)


def _full_check(pipeline: Pipeline, pairs: Sequence[Pair], change: DiveChange) -> DiveVerdict:
    """What ``check`` says of the dive."""
    rig, images = pipeline.rig, pipeline.config.input
    found = matches_of(pipeline.rectification, evenly_spaced(pairs, COMPARED), images)
    judged = judge_rig(rig, list(found.matches.values()), pairs, images, change)
    stated = stated_of_sides(pairs, rig)
    if judged.refusal:
        raise InputError("; ".join(filter(None, (judged.refusal, stated))))
    rows = judged.with_motion(rig, list(found.matches.values()), pairs, images).rows
    if rows is None and not change.is_rigid:
        return DiveVerdict((f"calibration: {change.line}",), RANGES)
    if rows is None:
        return NOTHING_FOUND
    if not replace(rows, odd="").advice:
        return DiveVerdict(measured=rows.measured)
    refine = " (stereo-seecolor run --refine)" if rows.has_moved else ""
    advice = f"calibration: {'; '.join(replace(rows, odd='').advice)}{refine}"
    return DiveVerdict(
        (advice, stated) if stated and rows.ranges_are_wrong else (advice,),
        RANGES if rows.ranges_are_wrong else frozenset(),
        rows.measured,
    )


@dataclass(frozen=True, eq=False)
class JudgedRig:
    """A calibration against a dive. rows: None where too few points were found in both images, and
    too_few says so. mistake: the usual one that explains rows which no movement of a camera does.

    refusal: why no ranges can be had from these images with this calibration, and what to do; ""
    where they may be.
    """

    rows: RowCheck | None
    mistake: FoundMistake | None = None
    refusal: str = ""
    too_few: str = ""

    def with_motion(
        self, rig: StereoRig, matches: Sequence[Matches], pairs: Sequence[Pair], images: InputConfig
    ) -> "JudgedRig":
        """With the motion between neighboring pairs, and what explains it and the rows."""
        if self.rows is None or self.refusal or self.rows.change or self.rows.swapped:
            return self
        couples = couples_of(rig, pairs, images)
        geometry = plan_rectification(rig).matching_pair
        motion = motion_of(couples, geometry)
        causes = find_causes(rig, matches, couples)
        if causes.best and (not causes.explains or changes_in_time(couples, geometry)):
            causes = _in_parts(causes, rig, matches, pairs, images)
        return replace(self, rows=replace(self.rows, motion=motion, causes=causes))


def _in_parts(
    causes: Causes,
    rig: StereoRig,
    matches: Sequence[Matches],
    pairs: Sequence[Pair],
    images: InputConfig,
) -> Causes:
    """Causes with those of the beginning and the end of a dive, where they explain these and
    nothing explains all: a change after a quarter, a half or three quarters.
    """

    def of_part(begin: float, end: float) -> Causes:
        first, last = (round(place * len(pairs)) for place in (begin, end))
        couples = couples_of(rig, pairs[first:last], images)
        first, last = (round(place * len(matches)) for place in (begin, end))
        return find_causes(rig, matches[first:last], couples)

    for place in PARTED_AT:
        if min(place, 1 - place) * len(matches) < LEAST_PAIRS:
            continue
        before = of_part(0, place)
        found = causes.in_parts(before, of_part(place, 1)) if before.explains else causes
        if found.parts:
            return found
    return causes


def couples_of(rig: StereoRig, pairs: Sequence[Pair], images: InputConfig) -> list[SeenTwice]:
    """Points of neighboring pairs spread over the dive."""
    return list(_couples(Rectification.from_rig(rig), neighbors(pairs, images)))


def _couples(
    rectification: Rectification, starts: Iterable[Iterable[Images]]
) -> Iterator[SeenTwice]:
    """Points that are seen twice, on all cores. starts: for each couple as ``couple_of``."""
    threads = matching_threads(rectification.raw_size)
    return filter(None, threads.each(lambda near: couple_of(rectification, near), starts))


def refine_on_dive(
    rig: StereoRig, raw: Sequence[Matches], pairs: Sequence[Pair], images: InputConfig
) -> StereoRig:
    """``refine_matches``; a cause that rows name and refining would hide is tested on the motion
    between pairs of the dive, too, which takes longer. Raises CalibrationError.
    """
    # scipy.optimize: half a second that other runs need not wait for
    from calibration.refine import HiddenCauseError, refine_matches

    try:
        return refine_matches(rig, raw)
    except HiddenCauseError:
        settled = settle_matches(rig, raw)
        couples = couples_of(settled, pairs, images)
        if not couples:
            raise
        return refine_matches(settled, raw, couples)


def judge_rig(
    rig: StereoRig,
    matches: Sequence[Matches],
    pairs: Sequence[Pair],
    images: InputConfig,
    change: DiveChange,
) -> JudgedRig:
    """Judge a rig by matches in its rectified images, and by what changes from pair to pair.

    matches: of pairs spread over the dive. pairs: of the dive, without odd ones.
    """
    rows, too_few = None, ""
    try:
        rows = judge_matches(rig, matches)
    except CalibrationError as error:
        too_few = str(error)
    mistake: FoundMistake | None = None
    refusal = rows.refusal if rows else ""
    if not refusal and (rows is None or may_be_wrong(rows)):
        rival = rows.causes.rig_of_one if rows else None
        few = first_images(evenly_spaced(pairs, DECIDING_PAIRS), images)
        mistake = likely_mistake(rig, few, rival)
        refusal = (
            mistake.line if mistake else constant_shift(pairs, Rectification.from_rig(rig), images)
        )
    if rows is None:
        return JudgedRig(None, mistake, refusal, too_few)
    odd, other = (change.line, "") if change.is_rigid else ("", change.line)
    return JudgedRig(replace(rows, mistake=refusal, odd=odd, change=other), mistake, refusal)


@dataclass(frozen=True, eq=False)
class FoundMatches:
    """matches: of each pair in its rectified images. problems: of each pair that cannot be read, or
    is not as large as calibrated, why.
    """

    matches: dict[Pair, Matches]
    problems: dict[Pair, str]


def matches_of(
    rectification: Rectification, pairs: Sequence[Pair], images: InputConfig
) -> FoundMatches:
    """Match pairs on all cores."""

    def matched(pair: Pair) -> Matches | str:
        try:
            both = read_both(pair, images)
            return find_matches(rectification, *both)
        except (InputError, CalibrationError) as error:
            return str(error)

    threads = matching_threads(rectification.raw_size)
    outcomes = dict(zip(pairs, threads.each(matched, pairs), strict=True))
    return FoundMatches(
        {pair: one for pair, one in outcomes.items() if isinstance(one, Matches)},
        {pair: one for pair, one in outcomes.items() if isinstance(one, str)},
    )
