"""Pairs from two streams of images with times, such as those of two cameras or two topics."""

import time
from collections import deque
from collections.abc import Callable
from itertools import pairwise
from math import inf
from pathlib import Path
from statistics import median
from typing import NamedTuple

from stereo_seecolor.config import InputConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.streams.bags.dive import stamp_name
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.records import Image, StereoFrame

KEPT = 4
"""Images of a stream that are kept for a partner: the other side may be late by so many."""

QUIET_S = 5.0
"""Seconds without an image after which a stream that is open counts as one that sends nothing."""

NEAR = 0.45
"""Largest difference of the times of a pair, as a fraction of the time between images: beyond, it
is another pair's image.
"""


class Arrived(NamedTuple):
    """An image of a stream. stamp_ns: time of capture, since 1970. arrived_s: of
    ``time.monotonic``. image: decodes it.
    """

    stamp_ns: int
    arrived_s: float
    image: Callable[[], Image]


class ImageStream:
    """The last images of one side; filled by one thread and read by another.

    waiting: the name while nothing arrives, else "". received: number of images so far.
    """

    def __init__(self, name: str) -> None:
        self.name = self.waiting = name
        self.received = 0
        self._kept: deque[Arrived] = deque(maxlen=KEPT)

    @property
    def newest(self) -> tuple[Arrived, ...]:
        """The last images, oldest first."""
        return tuple(self._kept)

    @property
    def is_quiet(self) -> bool:
        """True where no image has come for some time."""
        if self.waiting or not self._kept:
            return True
        return time.monotonic() - self._kept[-1].arrived_s > QUIET_S

    def add(self, image: Arrived) -> None:
        """Add an image that has arrived."""
        self._kept.append(image)
        self.received += 1
        self.waiting = ""

    def receive(self) -> None:
        """Add the images that have arrived, for streams that no thread fills."""


class StreamPairs:
    """A live source of two streams: the newest two images taken at the same time. dropped: left
    images skipped.
    """

    ended = False

    def __init__(self, left: ImageStream, right: ImageStream, config: InputConfig) -> None:
        self.dropped = 0
        self._left, self._right, self._tolerance_s = left, right, config.timestamp_tolerance_s
        self._offered: tuple[Arrived, Arrived] | None = None
        self._taken_s, self._counted = -inf, 0

    @property
    def waiting(self) -> str:
        """Names of the streams from which nothing arrives; "" for none."""
        self._receive()
        quiet = (stream.name for stream in (self._left, self._right) if stream.is_quiet)
        return " and ".join(dict.fromkeys(quiet))

    @property
    def has_unpaired(self) -> bool:
        """True where one side sends images now, or both send images of other times."""
        return not (self._left.is_quiet and self._right.is_quiet)

    def newest(self) -> Pair | None:
        """The newest pair that was not taken, or None."""
        self._receive()
        lefts, rights = self._left.newest, self._right.newest
        for left in reversed(lefts):
            if left.arrived_s <= self._taken_s:  # not by stamps: clocks are set back
                return None
            right = _nearest(rights, left.stamp_ns)
            if right and abs(right.stamp_ns - left.stamp_ns) <= self._reach_ns(lefts):
                self._offered = left, right
                name = stamp_name(left.stamp_ns)
                return Pair(
                    name,
                    Path(self._left.name, "left", name),
                    Path(self._right.name, "right", name),
                    left.stamp_ns / 1e9,
                )
        return None

    def read(self, pair: Pair) -> StereoFrame:
        """The two images of the last offered pair. Raises InputError if it is gone or damaged."""
        if self._offered is None or stamp_name(self._offered[0].stamp_ns) != pair.name:
            raise InputError(f"{pair.name}: was removed: a newer pair has come")
        left, right = (side.image() for side in self._offered)
        return StereoFrame(pair.name, left, right, pair.timestamp_s)

    def take(self, pair: Pair) -> None:
        """Mark this pair and all before it as done."""
        assert self._offered is not None
        received = self._left.received - sum(
            image.arrived_s > self._offered[0].arrived_s for image in self._left.newest
        )
        self.dropped += max(0, received - self._counted - 1)
        self._counted, self._taken_s = received, self._offered[0].arrived_s

    def still_there(self) -> tuple[Pair, ...]:
        """None: a stream keeps only its last images."""
        return ()

    def latency_s(self, pair: Pair) -> float:
        """Seconds since the later image of the pair that was offered last arrived."""
        return (
            time.monotonic() - max(side.arrived_s for side in self._offered)
            if self._offered
            else 0.0
        )

    def _receive(self) -> None:
        self._left.receive()
        self._right.receive()

    def _reach_ns(self, lefts: tuple[Arrived, ...]) -> float:
        apart_ns = [after.stamp_ns - before.stamp_ns for before, after in pairwise(lefts)]
        return max(self._tolerance_s * 1e9, NEAR * median(apart_ns) if apart_ns else 0.0)


def _nearest(images: tuple[Arrived, ...], stamp_ns: int) -> Arrived | None:
    return min(images, key=lambda image: abs(image.stamp_ns - stamp_ns), default=None)
