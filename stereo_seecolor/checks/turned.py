"""A check for images whose EXIF orientation differs from the others of their side: a camera that
looks straight down guesses which way is up, and readers turn its images by that tag.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from calibration import CalibrationError
from calibration.errors import counted
from calibration.verification.changes import PairRows, differ
from stereo_seecolor.checks.exif_heads import LOOKED_AT, exif_head
from stereo_seecolor.checks.sample import evenly_spaced, read_both
from stereo_seecolor.config import InputConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.records import Image

TESTED = 3
"""Turned pairs whose pixels are tested: other causes give other tags too, as a viewer that turned
the pixels and reset the tag."""
QUARTERS = {1: 0, 8: 1, 3: 2, 6: 3}
"""Counterclockwise quarters of a turn by which readers turn an image of that tag (EXIF 2.32); the
other tags mirror."""
FEWEST = 2
"""Pairs of the usual tags: of fewer, none is usual."""
Look = Callable[[tuple[Image, Image]], PairRows | None]


def turned_pairs(
    pairs: Sequence[Pair], images: InputConfig, look: Look
) -> tuple[str, frozenset[str]]:
    """Find pairs that EXIF turns otherwise than the others, which do not fit the rig as they are
    read, and do without that.

    look: describes the rows of two images; None where they show too little. Returns what to say,
    with the first image, its tag and what to do, and the names of the pairs; "" and none where
    there are none.
    """
    seen = [
        (pair, (exif_head(pair.left).orientation, exif_head(pair.right).orientation))
        for pair in evenly_spaced(pairs, LOOKED_AT)
    ]
    counts = Counter(tags for _, tags in seen)
    if len(counts) < 2:
        return "", frozenset()
    usual, often = counts.most_common(1)[0]
    turned = [(pair, tags) for pair, tags in seen if tags != usual]
    if often < max(FEWEST, len(turned)) or not {*usual} <= QUARTERS.keys():
        return "", frozenset()
    turned = [(pair, tags) for pair, tags in turned if {*tags} <= QUARTERS.keys()]
    tested = evenly_spaced(turned, TESTED)
    upright = evenly_spaced([pair for pair, tags in seen if tags == usual], TESTED)
    with suppress(InputError, CalibrationError):
        reference = next(
            (rows for pair in upright if (rows := look(read_both(pair, images)))), None
        )
        if reference is None or not tested:
            return "", frozenset()

        def fits(both: tuple[Image, Image]) -> bool:
            with suppress(CalibrationError):  # of another size, if it is turned by a quarter
                rows = look(both)
                return rows is not None and not differ(rows, reference)
            return False

        if all(_is_turned(pair, tags, usual, images, fits) for pair, tags in tested):
            return _line(turned, usual), frozenset(pair.name for pair, _ in turned)
    return "", frozenset()


def _is_turned(
    pair: Pair,
    tags: tuple[int, int],
    usual: tuple[int, int],
    images: InputConfig,
    fits: Callable[[tuple[Image, Image]], bool],
) -> bool:
    both = read_both(pair, images)
    quarters = [QUARTERS[other] - QUARTERS[own] for own, other in zip(tags, usual, strict=True)]
    back: Any = [np.ascontiguousarray(np.rot90(both[side], quarters[side])) for side in (0, 1)]
    return not fits(both) and fits((back[0], back[1]))


def _line(turned: Sequence[tuple[Pair, tuple[int, int]]], usual: tuple[int, int]) -> str:
    pair, tags = turned[0]
    side = 0 if tags[0] != usual[0] else 1
    path = (pair.left, pair.right)[side]
    return (
        f"{path.name} ({('left', 'right')[side]}): EXIF Orientation is {tags[side]}, and "
        f"{usual[side]} in the other images of its side: {counted(len(turned), 'pair')} of "
        f"such tags, from {pair.name} to {turned[-1][0].name}: they fit the rig of the other "
        "pairs only without the rotation of their tag, and are left out: set the tag as in "
        f"the other images (exiftool -n -Orientation={usual[side]} on copies of these images)"
    )
