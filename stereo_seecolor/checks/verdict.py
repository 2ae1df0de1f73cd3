"""The results of checks of a dive, and checks as one list."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import reduce

from calibration.rig_errors import RangeError
from stereo_seecolor.checks.sample import DiveImages
from stereo_seecolor.records import Numbers


@dataclass(frozen=True)
class DiveVerdict:
    """What a check found.

    notes: a line each: what is wrong, where, what to do; none where all is well, or where it cannot
    be told. wrong: the numbers of the output that are wrong by more than they state. measured: the
    error of ranges, None where it was not measured.
    """

    notes: tuple[str, ...] = ()
    wrong: frozenset[Numbers] = frozenset()
    measured: RangeError | None = None

    def after(self, earlier: "DiveVerdict") -> "DiveVerdict":
        """Both, the notes of the earlier one first."""
        return DiveVerdict(
            (*earlier.notes, *self.notes),
            self.wrong | earlier.wrong,
            self.measured or earlier.measured,
        )


NOTHING_FOUND = DiveVerdict()
COLORS: frozenset[Numbers] = frozenset(("colors",))
RANGES: frozenset[Numbers] = frozenset(("ranges",))


@dataclass(frozen=True)
class Check:
    """A question that is asked of a dive's images. costs: what it reads."""

    name: str
    costs: str
    find: Callable[[DiveImages], DiveVerdict]


def verdict_of(checks: Iterable[Check], images: DiveImages) -> DiveVerdict:
    """What these checks find, in their order."""
    return reduce(lambda found, check: check.find(images).after(found), checks, NOTHING_FOUND)
