"""A check for a focal length that changes within a dive, as EXIF states it: of a zoom lens, or of
another one. Zoomed alike, two cameras keep their rows, and no pixel shows it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from calibration import StereoRig
from stereo_seecolor.checks.exif_heads import LOOKED_AT, exif_head
from stereo_seecolor.checks.sample import DiveImages, ends_of_part, evenly_spaced
from stereo_seecolor.checks.verdict import RANGES, DiveVerdict
from stereo_seecolor.inputs.pairing import Pair

LEAST = 0.02
"""Of the focal length, and so of ranges: what ``check`` accepts."""


@dataclass(frozen=True)
class _Change:
    """At these places of the dive, the first and the last, a side states another focal length than
    its first image does.
    """

    first: int
    last: int
    before_mm: float
    then_mm: float


def changed_focal_lengths(images: DiveImages) -> DiveVerdict:
    """What EXIF states of the focal lengths of each side.

    Of one side alone the rows of the images show whether it is true, and are checked elsewhere.
    """
    found = {side: _change(images.pairs, side) for side in ("left", "right")}
    changes = {side: change for side, change in found.items() if change}
    sides: dict[_Change, list[str]] = {}
    for side, change in changes.items():
        sides.setdefault(change, []).append(side)
    notes = tuple(_note(images.pairs, change, of) for change, of in sides.items())
    return DiveVerdict(notes, RANGES if len(changes) == 2 else frozenset())


def stated_of_sides(pairs: Sequence[Pair], rig: StereoRig) -> str:
    """A note where EXIF of the two sides states another ratio of their focal lengths than the
    calibration has. For images that contradict it: sensors of two sizes have other ratios, too.
    """
    left, right = (exif_head(path).focal_mm for path in (pairs[0].left, pairs[0].right))
    calibrated = rig.left.K[0, 0] / rig.right.K[0, 0]
    if not left or not right or abs(left / right / calibrated - 1) <= LEAST:
        return ""
    return (
        f"input: EXIF states focal lengths of {left:g} mm (left) and {right:g} mm (right), "
        f"{left / right:.3g} to 1, and in the calibration they are {calibrated:.3g} to 1: is a "
        "lens zoomed otherwise than when it was calibrated?"
    )


def _change(pairs: Sequence[Pair], side: str) -> _Change | None:
    def focal_mm(place: int) -> float | None:
        return exif_head(getattr(pairs[place], side)).focal_mm

    looked_at = evenly_spaced(range(len(pairs)), LOOKED_AT)
    stated = {place: mm for place in looked_at if (mm := focal_mm(place))}
    if not stated:
        return None
    before_mm = next(iter(stated.values()))

    def differs(place: int) -> bool:
        mm = focal_mm(place)
        return mm is not None and abs(mm / before_mm - 1) > LEAST

    other = [place for place in stated if differs(place)]
    if not other:
        return None
    first, last = ends_of_part(looked_at, other, differs)
    return _Change(first, last, before_mm, stated[other[0]])


def _note(pairs: Sequence[Pair], change: _Change, sides: Sequence[str]) -> str:
    first, last = pairs[change.first].name, pairs[change.last].name
    to_end = change.last == len(pairs) - 1
    where = f"from {first} on" if to_end else f"from {first} to {last}"
    return (
        f"input: {where}, EXIF of the {' and '.join(sides)} images states a focal length of "
        f"{change.then_mm:g} mm, and {change.before_mm:g} mm before: if a lens was zoomed or "
        f"exchanged, ranges are wrong by {abs(change.then_mm / change.before_mm - 1):.0%} where "
        "the calibration is of the other: process the parts separately, each with its own "
        "calibration"
    )
