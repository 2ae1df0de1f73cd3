"""A topic whose messages are the pictures of a video (H.264, H.265): each picture with the stamp
of its message, decoded from the keyframe before it. By PyAV (FFmpeg).
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from stereo_seecolor.compute.threads import Lock
from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.streams.bags.bag import COMPRESSED_IMAGES, VIDEOS, Bag, Entry, Topic
from stereo_seecolor.extras.streams.bags.coded_units import Coded, Units, codec_of
from stereo_seecolor.extras.streams.bags.messages import coding, decode
from stereo_seecolor.files.image_headers import MAX_PIXELS
from stereo_seecolor.files.tiff import encode_tiff
from stereo_seecolor.inputs.video_file import NEAR_FRAMES, RecentFrames
from stereo_seecolor.inputs.video_frames import pixels
from stereo_seecolor.inputs.video_streams import video_library

REORDERED = 16
"""A picture is shown at most so many later than it is decoded (H.264, max_dec_frame_buffering)."""
KEYS_BACK = 2
"""Keyframes from which decoding may begin: pictures that follow one of an open group and are shown
before it need the one before.
"""


class CodedVideo:
    """The pictures of a topic. topic: with those messages alone that can be shown. notes: a line on
    each kind that is left out.

    Raises InputError where none can be shown, or they are of a codec that is not read; DeviceError
    without PyAV or rosbags.
    """

    def __init__(self, bag: Bag, topic: Topic, codec: str) -> None:
        self._where, self._codec = f"{bag.path}: {topic.name}", codec
        self._library = video_library()
        self._sent = _as_sent(bag, topic.entries)
        units = Units(codec)
        self._coded = [_coded(units, entry) for entry in self._sent]
        self._keys = [i for i, coded in enumerate(self._coded) if coded.is_key]
        self.topic, self.notes = self._shown(topic)
        self._numbers = {id(entry): i for i, entry in enumerate(self._sent)}
        self._lock = Lock()
        self._kept = RecentFrames()
        self._frames: Iterator[tuple[int, Any | None]] = iter(())
        self._last = -1

    def content(self, entry: Entry) -> bytes:
        """A picture as an uncompressed TIFF. Raises InputError where it cannot be decoded."""
        number = self._numbers[id(entry)]
        with self._lock:
            frame = self._frame(number)
            rgb = None if frame is None else pixels(frame)
        if rgb is None:
            raise InputError(
                f"{self._where}: the picture of {entry.stamp_ns / 1e9:.3f} s cannot be decoded: it "
                "is damaged, or a frame that it depends on is"
            )
        return encode_tiff(rgb)

    def _shown(self, topic: Topic) -> tuple[Topic, tuple[str, ...]]:
        first = next(iter(self._keys), None)
        if first is None:
            raise InputError(
                f"{self._where}: none of its {len(self._sent)} messages is a keyframe "
                f"({self._codec}), from which decoding could begin: record it again with "
                "keyframes, for example one a second"
            )
        kept, early, lost, is_broken = [], 0, 0, False
        for i, (entry, coded) in enumerate(zip(self._sent, self._coded, strict=True)):
            is_broken = not coded.is_key and (is_broken or coded.is_lost)
            if not coded.is_picture:
                continue
            if i < first:
                early += 1
            elif is_broken:
                lost += 1
            else:
                kept.append(entry)
        counts = (
            (early, "come before its first keyframe"),
            (lost, "depend on a missing one, up to the next keyframe"),
        )
        notes = tuple(
            f"{self._where}: {count} of {len(self._sent)} pictures {why}: left out"
            for count, why in counts
            if count
        )
        shown = tuple(sorted(kept, key=lambda entry: entry.stamp_ns))
        return replace(topic, entries=shown, count=len(shown)), notes

    def _frame(self, number: int) -> Any | None:
        """A picture by its place among the messages; None where it cannot be decoded."""
        if number in self._kept:
            return self._kept[number]
        if self._is_near(number):
            return self._found(number)
        before = [key for key in self._keys if key <= number]
        for key in before[: -KEYS_BACK - 1 : -1]:
            self._frames = self._decoded(key)
            if frame := self._found(number):
                return frame
        return None

    def _is_near(self, number: int) -> bool:
        """True if the decoder comes to the picture soon."""
        if not 0 <= self._last < number:
            return False
        return number - self._last <= NEAR_FRAMES or not any(
            self._last < key <= number for key in self._keys
        )

    def _found(self, number: int) -> Any | None:
        """Decode on until the picture; None where it is damaged."""
        for last, frame in self._frames:
            self._last = last
            if frame is not None:
                self._kept.keep(last, frame)
            if last == number:
                return frame
        return None

    def _decoded(self, first: int) -> Iterator[tuple[int, Any | None]]:
        """The pictures from a keyframe on, in the order of the messages; None for one that is
        damaged, or builds on such a one: a decoder fills it with what was there before.
        """
        av = self._library
        decoder = av.CodecContext.create(self._codec, "r")
        decoder.options = {"err_detect": "explode", "max_pixels": str(MAX_PIXELS)}
        decoder.thread_type = "SLICE"
        end, given = len(self._sent), first
        came: dict[int, Any] = {}
        failed: set[int] = set()
        is_broken = before_is_broken = True
        for number in range(first, end + 1):
            try:
                before = self._coded[first].parameters if number == first else b""
                packet = self._packet(number, before)
                came |= {frame.pts: frame for frame in decoder.decode(packet)}
            except (av.FFmpegError, InputError):
                failed.add(number)
            while given < end and (
                given in came or given in failed or number > min(given + REORDERED, end - 1)
            ):
                coded, frame = self._coded[given], came.pop(given, None)
                if coded.is_key:
                    before_is_broken, is_broken = is_broken, False
                is_bad = given in failed or frame is None or bool(frame.is_corrupt)
                if coded.is_picture and not coded.is_leading:
                    is_broken = is_bad = is_broken or is_bad
                elif before_is_broken:
                    is_bad = True
                yield given, None if is_bad else frame
                given += 1

    def _packet(self, number: int, before: bytes) -> Any:
        """None after the last one: it makes the decoder give what it holds back."""
        if number == len(self._sent):
            return None
        packet = self._library.Packet(before + bytes(decode(self._sent[number]).data))
        packet.pts = number
        return packet


def _coded(units: Units, entry: Entry) -> Coded:
    try:
        return units.look(bytes(decode(entry).data))
    except InputError:  # a damaged message
        return Coded(True, is_lost=True)


def open_video(bag: Bag, topic: Topic) -> CodedVideo | None:
    """The video of a topic; None if its messages are images. Raises InputError, DeviceError."""
    if topic.msgtype not in (*VIDEOS, *COMPRESSED_IMAGES) or not topic.entries:
        return None
    form = coding(decode(topic.entries[0]))
    if codec := codec_of(form):
        return CodedVideo(bag, topic, codec)
    if topic.msgtype in VIDEOS:
        raise InputError(
            f"{bag.path}: {topic.name}: is coded as {form!r}: H.264 and H.265 are read"
        )
    return None


def starts_in_the_middle(bag: Bag) -> bool:
    """Tell whether a bag holds a video that begins without a keyframe, as each further file of a
    bag that was split does. Raises InputError, DeviceError.
    """
    for topic in bag.topics:
        if topic.msgtype in (*VIDEOS, *COMPRESSED_IMAGES) and topic.entries:
            first = decode(_as_sent(bag, topic.entries)[0])
            codec = codec_of(coding(first))
            if codec and not Units(codec).look(bytes(first.data)).is_key:
                return True
    return False


def _as_sent(bag: Bag, entries: Sequence[Entry]) -> list[Entry]:
    """In the order in which they were recorded, which is that of decoding."""
    order: dict[Path, int] = {file: i for i, file in enumerate(bag.files)}

    def place(entry: Entry) -> tuple[int, int, int]:
        chunk = entry.place.chunk
        return order[entry.path], chunk.start if chunk else entry.place.start, entry.place.start

    return sorted(entries, key=place)
