"""Why the two images of some pairs show different scenes: a camera that stalled, or images of one
side that are turned or mirrored.
"""

import contextlib
import filecmp
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np

from calibration import CalibrationError, Rectification
from calibration.errors import counted
from calibration.verification.matches import describe_left, describe_right
from calibration.verification.same_scene import ENOUGH_POINTS, agreeing_points
from stereo_seecolor.checks.sample import evenly_spaced, read_both
from stereo_seecolor.config import InputConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.pairing import Pair

Side = Literal["left", "right"]
SIDES: tuple[Side, ...] = ("right", "left")
LOOKED_AT = 3
"""Failed pairs that are compared in each way, which takes as long as matching some pairs."""
CLEARLY = 1.5
"""Times as many points as the other side flipped: a mirrored pair fits a rig that is nearly
symmetric about as well."""
FLIPS = {
    "rotated by 180 degrees": (slice(None, None, -1), slice(None, None, -1)),
    "mirrored left to right": (slice(None), slice(None, None, -1)),
    "mirrored top to bottom": (slice(None, None, -1), slice(None)),
}


def stalled_note(misfits: Sequence[tuple[int, Pair]], pairs: Sequence[Pair]) -> str:
    """Name the side whose images are all that of the pair before the failed ones; "" where neither
    is. misfits: the failed pairs with their places.
    """
    for side in SIDES:
        looked_at = evenly_spaced([place for place, _ in misfits], LOOKED_AT)
        if all(
            place and _is_same(getattr(pairs[place - 1], side), getattr(pairs[place], side))
            for place in looked_at
        ):
            first, last = misfits[0][0], misfits[-1][0]
            return (
                f"{_named(misfits)}: the {side} images are all that of {pairs[first - 1].name}: "
                f"the {side} camera stalled, or files were copied: give its own images, or leave "
                f"{'this pair' if first == last else 'these pairs'} out"
            )
    return ""


def flipped_note(
    misfits: Sequence[tuple[int, Pair]], rectification: Rectification, config: InputConfig
) -> str:
    """Name the side whose images fit only turned or mirrored; "" where neither is."""
    looked_at = evenly_spaced([pair for _, pair in misfits], LOOKED_AT)
    points = sum((_flipped_points(pair, rectification, config) for pair in looked_at), Counter())
    (best, most), *_ = points.most_common(1) or [(("right", ""), 0)]
    if most < ENOUGH_POINTS * len(looked_at):
        return ""
    side, how = best
    other = points["left" if side == "right" else "right", how]
    which = f"the {side} images" if most > CLEARLY * other else "the images of one side"
    back = "rotate" if how.startswith("rotated") else "mirror"
    return (
        f"{_named(misfits)}: {which} are {how} relative to those of the other pairs: "
        f"they fit if that is undone: {back} them back"
    )


def _flipped_points(
    pair: Pair, rectification: Rectification, config: InputConfig
) -> Counter[tuple[Side, str]]:
    """The points that agree with one side flipped; none of images that cannot be used."""
    points = Counter[tuple[Side, str]]()
    with contextlib.suppress(InputError, CalibrationError):
        left, right = read_both(pair, config)
        as_given = describe_left(rectification, left), describe_right(rectification, right)
        for how, flip in FLIPS.items():
            others = (
                describe_left(rectification, np.ascontiguousarray(left[flip])),
                describe_right(rectification, np.ascontiguousarray(right[flip])),
            )
            points["right", how] = agreeing_points(rectification, as_given[0], others[1])
            points["left", how] = agreeing_points(rectification, others[0], as_given[1])
    return points


def _is_same(one: Path, other: Path) -> bool:
    try:
        return filecmp.cmp(one, other, shallow=False)
    except OSError:
        return False


def _named(misfits: Sequence[tuple[int, Pair]]) -> str:
    first, last = misfits[0][1].name, misfits[-1][1].name
    if first == last:
        return first
    return f"from {first} to {last} ({counted(len(misfits), 'pair')} that failed)"
