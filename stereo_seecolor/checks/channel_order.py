"""Checks for left images whose red and blue are exchanged, from one on or in all.

Another white balance may change the colors of an image as exchanged channels do. At points that
both images show it does not: where one image is redder, the other is redder, too.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.errors import counted
from calibration.verification.matches import similar_points
from calibration.verification.same_scene import ENOUGH_POINTS
from stereo_seecolor.checks.sample import (
    COLORS_OF,
    SIDES_OF,
    DiveImages,
    edge,
    ends_of_part,
    evenly_spaced,
)
from stereo_seecolor.checks.verdict import COLORS, NOTHING_FOUND, DiveVerdict
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.images import read_image
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.records import Array, Image

QUANTILES = (0.1, 0.3, 0.5, 0.7, 0.9)
"""Of each channel of an image."""
DARK = 0.015
"""Fraction of full scale that is added, since the noise of dark pixels is not color."""
APART, TIMES = 0.05, 2.0
"""By how much the logarithms of two images' red and blue over green must differ at least, and how
many times as much as with red and blue exchanged. Of neighbors and of every fifth frame of a real
reef, FLSea and the sample dive: at most 0.3 times as given, 3.6 and more exchanged; nearly gray
images at most 1.1 times.
"""
CORRELATION = 0.2
"""Difference of the correlations of colors at points, as given and with red and blue exchanged,
that tells which is right: 0.33 to 3.1 of a real reef, a real video and the sample dive, whatever
the white balance.
"""
OR_BALANCE = " (or another white balance: too few points that both show tell)"
AROUND_PX = 5
"""Side of the square whose mean is the color at a point."""
Colors = NDArray[np.float64]
"""(3, quantiles) logarithms of the values of R, G, B."""


def channel_order(images: DiveImages) -> DiveVerdict:
    """The left images of which red and blue are exchanged against those before, first and last.

    Of a single image other causes are as likely (another camera, light or scene), so that its
    colors alone are named.
    """
    pairs = images.pairs
    looked_at = evenly_spaced(range(len(pairs)), COLORS_OF)
    with suppress(InputError):
        before = _colors(images, pairs[0].left) if pairs else None
        for first, last in pairwise(looked_at):
            after = _colors(images, pairs[last].left)
            if before is not None and _are_exchanged(before, after):
                place = edge(first, last, _differs_from(first, images))
                is_sure = _exchanged_at_points(images, pairs[place - 1].left, pairs[place].left)
                if is_sure is False:
                    return NOTHING_FOUND
                end = _last_exchanged(images, last, looked_at)
                other = images.config.input.other_channels
                note = f"input: {_exchanged_text(pairs, place, end, other, bool(is_sure))}"
                return DiveVerdict((note,), COLORS if end > place else frozenset())
            before = after
    return NOTHING_FOUND


def order_of_sides(images: DiveImages) -> DiveVerdict:
    """Left images whose red and blue are exchanged against the right ones: both show the same, so
    that one pair tells. Of a part of the dive the first and the last pair.
    """
    pairs = images.pairs

    def exchanged(place: int) -> bool:
        with suppress(InputError):
            sides = (pairs[place].left, pairs[place].right)
            return _are_exchanged(*(_colors(images, side) for side in sides))
        return False

    looked_at = evenly_spaced(range(len(pairs)), SIDES_OF)
    found = [place for place in looked_at if exchanged(place)]
    if not found:
        return NOTHING_FOUND
    left, right = pairs[found[0]].left, pairs[found[0]].right
    is_sure = _exchanged_at_points(images, left, right)
    if is_sure is False:
        return NOTHING_FOUND
    files = f"{left.parent.name}/{left.name} and {right.parent.name}/{right.name}"
    what = f"{files} have red and blue exchanged against each other{'' if is_sure else OR_BALANCE}"
    if found == looked_at:
        cure = f"if the right images are correct, --set {images.config.input.other_channels}"
    else:
        first, last = ends_of_part(looked_at, found, exchanged)
        what = f"{what}, as are pairs {pairs[first].name} to {pairs[last].name}, but not all"
        cure = "process the parts separately"
    return DiveVerdict((f"input: {what}: bring both sides to one order; {cure}",), COLORS)


def _exchanged_text(pairs: Sequence[Pair], first: int, last: int, other: str, is_sure: bool) -> str:
    name = pairs[first].left.name
    if first == last:
        return (
            f"{name}: its red and blue fit the images before and after only if they are exchanged: "
            "its channels may be in another order, or it shows another camera, light or scene: "
            "look at it, and leave it out or bring it to the order of the others"
        )
    which = (
        f"{name} and the following images"
        if last == len(pairs) - 1
        else f"{name} to {pairs[last].left.name}"
    )
    return (
        f"{which} ({counted(last - first + 1, 'image')}) have red and blue exchanged"
        f"{'' if is_sure else OR_BALANCE}, compared "
        f"with {pairs[first - 1].left.name} and before: bring all files to one order, or "
        f"process the parts separately, that one with --set {other}"
    )


def _last_exchanged(images: DiveImages, seen: int, looked_at: Sequence[int]) -> int:
    """The last image in a row that is exchanged as the one at ``seen`` is. looked_at: the places
    that are compared with it.
    """
    end = len(images.pairs)
    for later in (one for one in (*looked_at, end - 1) if one > seen):
        if _differs_from(seen, images)(later):
            end = later
            break
        seen = later
    return edge(seen, end, _differs_from(seen, images)) - 1


def _differs_from(place: int, images: DiveImages) -> Callable[[int], bool]:
    """Whether the image at another place is exchanged against the one here."""
    here = _colors(images, images.pairs[place].left)
    return lambda other: _are_exchanged(here, _colors(images, images.pairs[other].left))


def _colors(images: DiveImages, path: Path) -> Colors:
    image = images.thinned(path)
    values = np.quantile(image.reshape(-1, 3), QUANTILES, axis=0).T
    return np.log(values / np.iinfo(image.dtype).max + DARK)


def _exchanged_at_points(images: DiveImages, one: Path, other: Path) -> bool | None:
    """Whether points that two images show have red and blue exchanged; None where too few, or
    points of too little color, tell. Raises InputError.
    """
    pixels = [read_image(path, images.config.input) for path in (one, other)]
    found = similar_points(*pixels)
    if len(found.left) < ENOUGH_POINTS:
        return None
    ranks = [
        np.argsort(np.argsort(_tints(image, points), axis=0), axis=0)
        for image, points in zip(pixels, (found.left, found.right), strict=True)
    ]
    alike = np.asarray(np.corrcoef(np.hstack(ranks), rowvar=False))[:2, 2:]
    margin = float(alike[0, 1] + alike[1, 0] - alike[0, 0] - alike[1, 1])
    return margin > 0 if abs(margin) > CORRELATION else None


def _tints(image: Image, points: Array) -> Array:
    """(n, 2) logarithms of red and of blue over green around (n, 2) points."""
    column, row = np.round(points).astype(int).T
    rgb = cv2.blur(image, (AROUND_PX, AROUND_PX))[row, column]
    log = np.log(rgb / np.iinfo(image.dtype).max + DARK)
    return np.asarray(log[:, [0, 2]] - log[:, [1]])


def _are_exchanged(one: Colors, other: Colors) -> bool:
    given, exchanged = _apart(one, other), _apart(one, other[::-1])
    return given > max(APART, TIMES * exchanged)


def _apart(one: Colors, other: Colors) -> float:
    """How much red and blue over green differ between two images."""
    off = one - other
    return float(np.abs(off[[0, 2]] - off[1]).mean())
