"""The sample that checks use: the images of a dive, and pairs spread over it."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import chain, islice
from pathlib import Path
from typing import TypeVar

import numpy as np

from calibration.verification.matches import MATCH_LIMITS
from stereo_seecolor.compute.free_memory import at_once
from stereo_seecolor.compute.threads import Threads, cores
from stereo_seecolor.config import InputConfig, RunConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.images import read_image
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.records import Image

Item = TypeVar("Item")
Found = TypeVar("Found")

DECIDING_PAIRS = 3
"""Pairs that decide how an ambiguous calibration file is read: each gives hundreds of matches."""
COUPLES = 5
"""Pairs whose motion to a following one tests a calibration: each gives some hundred points."""
FOLLOWING = (0, 1, 2, 4, 8, 16, 32)
"""How many pairs later: frames of a video move little from one to the next."""
COLORS_OF, SIDES_OF = 5, 3
"""Left images, spread over the dive, whose colors are compared, and pairs whose sides are: the left
images of these are among the former.
"""
THINNED_PX = 4
"""Between the pixels of an image that show its colors."""


@dataclass(frozen=True, eq=False)
class DiveImages:
    """The image files of a dive.

    pairs: in order. config: settings, with the images as they are stored. known: ``thinned`` images
    that were read before.
    """

    pairs: Sequence[Pair]
    config: RunConfig
    known: Mapping[Path, Image] = field(default_factory=dict)

    @classmethod
    def with_colors(cls, pairs: Sequence[Pair], config: RunConfig) -> "DiveImages":
        """The images of pairs, with those whose colors several checks ask for, each read once."""
        lefts = [pair.left for pair in evenly_spaced(pairs, COLORS_OF)]
        rights = [pair.right for pair in evenly_spaced(pairs, SIDES_OF)]
        return cls(pairs, config, dict(of_each([*lefts, *rights], config.input, _thinned)))

    def thinned(self, path: Path) -> Image:
        """(h, w, 3) every fourth pixel of every fourth row of a file. Raises InputError."""
        found = self.known.get(path)
        return _thinned(read_image(path, self.config.input)) if found is None else found


def _thinned(image: Image) -> Image:
    some: Image = image[::THINNED_PX, ::THINNED_PX].copy()
    return some


def of_each(
    files: Iterable[Path], images: InputConfig, find: Callable[[Image], Found]
) -> list[tuple[Path, Found]]:
    """What is found in each image that can be read, on all cores."""

    def found(file: Path) -> list[tuple[Path, Found]]:
        with suppress(InputError):  # the run names it
            return [(file, find(read_image(file, images)))]
        return []

    return list(chain.from_iterable(Threads(cores()).each(found, files)))


def evenly_spaced(items: Sequence[Item], most: int) -> list[Item]:
    """At most ``most`` of the items, pairs or their places, evenly over the dive."""
    places = np.linspace(0, len(items) - 1, min(most, len(items))).round().astype(int)
    return [items[i] for i in np.unique(places)]


def edge(inside: int, outside: int, is_outside: Callable[[int], bool]) -> int:
    """The place nearest to ``inside`` that is outside, by halves, before or after it."""
    while abs(outside - inside) > 1:
        middle = (inside + outside) // 2
        if is_outside(middle):
            outside = middle
        else:
            inside = middle
    return outside


def ends_of_part(
    looked_at: Sequence[int], found: Sequence[int], is_in_part: Callable[[int], bool]
) -> tuple[int, int]:
    """The first and the last place of a part of the dive, between the places that were looked at;
    of those ``found`` in it, where a pair between cannot be read.
    """

    def end(outside: int, inside: int) -> int:
        with suppress(InputError):
            return edge(outside, inside, is_in_part)
        return inside

    before = [place for place in looked_at if place < found[0]]
    after = [place for place in looked_at if place > found[-1]]
    return (
        end(before[-1], found[0]) if before else found[0],
        end(after[0], found[-1]) if after else found[-1],
    )


def consecutive_intervals(places: Iterable[int]) -> list[tuple[int, int]]:
    """First and last of each interval of consecutive numbers. places: in increasing order."""
    parts: list[tuple[int, int]] = []
    for place in places:
        if parts and place == parts[-1][1] + 1:
            parts[-1] = (parts[-1][0], place)
        else:
            parts.append((place, place))
    return parts


def matching_threads(image_size: tuple[int, int]) -> Threads:
    """Threads that match images of this size: as many as there are cores, and free memory for."""
    return Threads(at_once(cores(), MATCH_LIMITS.bytes_of(image_size)))


def neighbors(
    pairs: Sequence[Pair], images: InputConfig
) -> Iterator[Iterator[tuple[Image, Image]]]:
    """For each of COUPLES pairs, spread over the dive, its images and those of pairs that follow
    it, for ``find_motion``.
    """
    for pair in evenly_spaced(pairs[:-1], COUPLES):
        place = pairs.index(pair)
        near = [pairs[place + step] for step in FOLLOWING if place + step < len(pairs)]
        yield (both for _, both in readable(near, images))


def read_both(pair: Pair, images: InputConfig) -> tuple[Image, Image]:
    """The left and the right image. Raises InputError."""
    return read_image(pair.left, images), read_image(pair.right, images)


def first_images(
    pairs: Sequence[Pair], images: InputConfig, most: int = DECIDING_PAIRS
) -> Iterator[tuple[Image, Image]]:
    """The images of the first pairs that can be read."""
    return (both for _, both in islice(readable(pairs, images), most))


def readable(
    pairs: Sequence[Pair], images: InputConfig
) -> Iterator[tuple[Pair, tuple[Image, Image]]]:
    """The pairs that can be read, with their images."""
    for pair in pairs:
        with suppress(InputError):  # the run names it
            yield pair, read_both(pair, images)
