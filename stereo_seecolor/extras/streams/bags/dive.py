"""A bag as a dive: its images, paired by their stamps, and its camera_info as the rig."""

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import pairwise
from pathlib import Path
from statistics import median

import numpy as np
from numpy.typing import NDArray

from calibration import StereoRig
from stereo_seecolor.config import InputConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.streams.bags.bag import IMAGES, VIDEOS, Bag, Topic, files_of, open_bag
from stereo_seecolor.extras.streams.bags.coded_video import (
    CodedVideo,
    open_video,
    starts_in_the_middle,
)
from stereo_seecolor.extras.streams.bags.messages import (
    camera_info,
    decode,
    frame_of,
    image_content,
    image_suffix,
    rig_of,
)
from stereo_seecolor.extras.streams.bags.static_transforms import between, static_frames
from stereo_seecolor.extras.streams.bags.topics import (
    SideTopics,
    info_topic,
    parse_topics,
    side_topics,
)
from stereo_seecolor.files.contained import Container, open_containers
from stereo_seecolor.inputs.pairing import Pair, Pairing, pair_files

GAP_INTERVALS = 3.5
"""Pairs farther apart than so many median intervals have a gap between; a lost frame is common."""


@dataclass(frozen=True)
class BagDive:
    """The dive of a bag. bag: what was read. sides: its two image topics. pairing: its pairs;
    infos: the camera_info of each side, or None.
    """

    bag: Bag
    sides: SideTopics
    pairing: Pairing
    infos: tuple[Topic | None, Topic | None]

    def rig(self) -> StereoRig:
        """The rig that the bag holds: by both camera_info, else by /tf_static.

        Raises InputError if it holds none, CalibrationError if it is none of a stereo pair.
        """
        left, right = self.infos
        if left is None or right is None:
            missing = " and ".join(
                side for side, topic in (("left", left), ("right", right)) if topic is None
            )
            raise InputError(
                f"{self.bag.path}: holds no camera_info of the {missing} camera: give --calib FILE"
            )
        return rig_of(left.entries[0], right.entries[0], self.static_baseline[0])

    @cached_property
    def static_baseline(self) -> tuple[NDArray[np.float64] | None, tuple[str, ...]]:
        """(4, 4) from left to right axes by /tf_static, None where camera_info tells it or nothing
        does; and a line on that.
        """
        left, right = self.infos
        if left is None or right is None:
            return None, ()
        with suppress(InputError):  # of a damaged message: ``rig`` says so
            messages = [decode(info.entries[0]) for info in (left, right)]
            if any(camera_info(message)["P"][column] for message in messages for column in (3, 7)):
                return None, ()
            frames, (start, end) = (
                static_frames(self.bag),
                [message.header.frame_id for message in messages],
            )
            T = between(frames, end, start)
            if T is not None and T[:3, 3].any():
                length_mm = 1000 * np.linalg.norm(T[:3, 3])
                return T, (
                    f"{self.bag.path}: camera_info holds no baseline: {length_mm:.1f} mm from "
                    f"{start} to {end} by /tf_static",
                )
            if frames:
                known = ", ".join(sorted(frames))
                return None, (
                    f"{self.bag.path}: /tf_static gives no baseline from {start!r} to {end!r}; "
                    f"its frames: {known}",
                )
        return None, ()


@dataclass(frozen=True)
class _Images(Container):
    """The images in one file of a bag, by their names."""

    contents: dict[str, Callable[[], bytes]]
    path: Path

    def read(self, name: str) -> bytes:
        if name not in self.contents:
            raise InputError(f"{self.path}: holds no image {name}")
        return self.contents[name]()


_Contents = dict[Path, dict[str, Callable[[], bytes]]]
"""File of a bag -> name of an image in it -> what makes its content."""


def open_dive(path: Path, topics: str, config: InputConfig) -> BagDive:
    """Walk a bag, find its two cameras (or take ``topics``, ``left=NAME,right=NAME``) and pair
    their images.

    Raises InputError, DeviceError.
    """
    given = parse_topics(topics)
    bag = open_bag(path)
    sides = side_topics(bag, given)
    videos = [open_video(bag, topic) for topic in (sides.left, sides.right)]
    left, right = (
        video.topic if video else topic
        for video, topic in zip(videos, (sides.left, sides.right), strict=True)
    )
    sides = replace(sides, left=left, right=right)
    images: _Contents = defaultdict(dict)
    lefts, rights = (
        _files_of(topic, images, video) for topic, video in zip((left, right), videos, strict=True)
    )
    open_containers({file: _Images(contents, file) for file, contents in images.items()})
    untimed = (
        " (headers hold no time; the times of recording are used)"
        if sides.left.name in bag.unstamped
        else ""
    )
    by_time = config.model_copy(update={"pairing": "timestamp"})  # all names are stamps
    pairing = pair_files(
        lefts, rights, by_time, f"{path}: {sides.left.name} and {sides.right.name}{untimed}"
    )
    infos = info_topic(bag, sides.left), info_topic(bag, sides.right)
    coded = tuple(note for video in videos if video for note in video.notes)
    notes = (*_notes(bag, sides, pairing), *coded, *_frame_notes(bag, sides, infos))
    return BagDive(bag, sides, pairing.with_notes(notes), infos)


def bag_images(path: Path) -> Container:
    """List all images of one file of a bag. Raises InputError, DeviceError."""
    images: _Contents = defaultdict(dict)
    bag = open_bag(path)
    if starts_in_the_middle(bag) and len(files_of(path.parent)) > 1:  # it goes on from another one
        bag = open_bag(path.parent)
    for topic in bag.topics:
        if topic.msgtype in (*IMAGES, *VIDEOS):
            with suppress(InputError):  # of a video without a keyframe, of another camera, say
                video = open_video(bag, topic)
                _files_of(video.topic if video else topic, images, video)
    return _Images(images[path], path)


def _files_of(topic: Topic, images: _Contents, video: CodedVideo | None) -> list[Path]:
    """The paths of a topic's images inside the bag's files; of two with one stamp the first."""
    suffix = ".tif" if video else image_suffix(topic.entries[0])
    content = video.content if video else image_content
    paths = []
    for entry in topic.entries:
        name = f"{topic.name.strip('/')}/{stamp_name(entry.stamp_ns)}{suffix}"
        if name not in images[entry.path]:
            images[entry.path][name] = partial(content, entry)
            paths.append(entry.path / name)
    return paths


def stamp_name(stamp_ns: int) -> str:
    """Name an image by its stamp: seconds and nanoseconds since 1970, ``1700000000-100000000``."""
    return f"{stamp_ns // 10**9:010d}-{stamp_ns % 10**9:09d}"


def _notes(bag: Bag, sides: SideTopics, pairing: Pairing) -> tuple[str, ...]:
    notes = [*bag.problems]
    chosen = (sides.left.name, sides.right.name)
    notes.append(
        f"{bag.path}: left is {chosen[0]}, right is "
        f"{chosen[1]}{' (guessed)' if sides.guessed else ''}"
        + (f"; for {', '.join(sides.others)} give --topics" if sides.others else "")
    )
    notes += [
        f"{bag.path}: {name}: headers hold no time; the times of recording are used"
        for name in bag.unstamped
        if name in chosen
    ]
    for topic in (sides.left, sides.right):
        if lost := topic.count - len({entry.stamp_ns for entry in topic.entries}):
            notes.append(
                f"{bag.path}: {topic.name}: {lost} of {topic.count} messages repeat the stamp of "
                "another message and are left out"
            )
    return (*notes, *gap_notes(pairing.pairs, bag.path))


def _frame_notes(
    bag: Bag, sides: SideTopics, infos: tuple[Topic | None, Topic | None]
) -> Iterator[str]:
    """A line for each camera_info whose frame_id differs from that of the images."""
    for topic, info in zip((sides.left, sides.right), infos, strict=True):
        with suppress(InputError):  # of a damaged message: its pair says so
            frames = [frame_of(decode(found.entries[0])) for found in (topic, info) if found]
            if len(set(filter(None, frames))) > 1 and info:
                yield (
                    f"{bag.path}: {info.name} is of the frame {frames[1]}, {topic.name} of "
                    f"{frames[0]}: does it belong to this camera?"
                )


def gap_notes(pairs: Sequence[Pair], path: Path) -> tuple[str, ...]:
    """Summarize the gaps between pairs in one line, with the longest."""
    times = [pair.timestamp_s for pair in pairs if pair.timestamp_s is not None]
    intervals = [later - earlier for earlier, later in pairwise(times)]
    if not intervals:
        return ()
    usual = median(intervals)
    gaps = [
        (interval, start)
        for interval, start in zip(intervals, times, strict=False)
        if interval > GAP_INTERVALS * usual
    ]
    if not gaps:
        return ()
    longest, start = max(gaps)
    counted = f"{len(gaps)} gaps" if len(gaps) > 1 else "1 gap"
    return (
        f"{path}: {counted} between pairs, which are usually {usual:.3g} s apart; the longest "
        f"{longest:.3g} s, at {start:.3f}",
    )
