"""A video's frames by number: an index of times; each is decoded from its keyframe on."""

from bisect import bisect_right
from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.threads import Lock
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.video_streams import decoded, opened, video_stream

KEPT_BYTES = 1 << 26
"""Kept decoded frames of a video: threads ask for neighbors, and more than once."""

NEAR_FRAMES = 8
"""A frame so few ahead is reached by decoding those between, keyframes too."""

BACK_S = (0.0, 1.0, 10.0)
"""How far before a frame decoding begins: pictures after the keyframe of an open group cannot be
decoded from it alone.
"""

LOST_S = 1.0
"""Sound may be longer than the pictures by less."""

OPEN_VIDEOS = 4

SAME_SHAPE = 0.02
"""Of the ratio of a pixel's sides: files round it, and lenses differ along x and y by some
thousandths.
"""

CURVES = {8: "linear light", 16: "high dynamic range (PQ)", 18: "high dynamic range (HLG)"}
PRIMARIES = {9: "primaries of BT.2020", 11: "primaries of P3", 12: "primaries of P3"}
"""Numbers of ITU-T H.273 that are not near sRGB: transfer characteristics, color primaries."""

ORDER_FRAMES = 12
"""So many frames tell whether a video's times rise; codecs reorder at most some."""

Times = NDArray[np.int64]
Read = TypeVar("Read")


@dataclass(frozen=True, eq=False)
class VideoIndex:
    """The index of a video's frames.

    pts: (n,) times of the frames, rising, in units of unit_s seconds. keys: (k,) those of
    keyframes. stated_s: duration that the file states, 0 where it states none. pixel_width: over
    the height of a pixel, as the file states (sample aspect ratio).
    """

    pts: Times
    keys: Times
    unit_s: float
    stated_s: float = 0.0
    pixel_width: float = 1.0

    @property
    def times_s(self) -> NDArray[np.float64]:
        """The times of the frames on the file's own clock: (n,)."""
        return np.asarray(self.pts * self.unit_s, np.float64)

    @property
    def frame_s(self) -> float:
        """Median time from frame to frame; infinite for one."""
        return float(np.median(np.diff(self.times_s))) if len(self.pts) > 1 else np.inf

    def numbers_at(self, times_s: NDArray[np.float64]) -> Times:
        """Find the frames that are nearest to these times: (m,) numbers."""
        middle = (self.times_s[1:] + self.times_s[:-1]) / 2
        return np.searchsorted(middle, times_s)


class RecentFrames(OrderedDict[int, Any]):
    """The frames that were decoded last (av.VideoFrame), by number: KEPT_BYTES, four at least."""

    def keep(self, number: int, frame: Any) -> None:
        """Keep a frame in place of the oldest."""
        self[number] = frame
        most = max(4, KEPT_BYTES // sum(plane.buffer_size for plane in frame.planes))
        while len(self) > most:
            self.popitem(last=False)


class VideoFile:
    """A video whose frames are had by number, in any thread. Raises InputError, DeviceError."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.index = _frame_index(path)
        self._lock = Lock()
        self._kept = RecentFrames()
        self._frames: Iterator[Any] = iter(())
        self._last: int | None = None

    def read(self, number: int, convert: Callable[[Any], Read]) -> Read:
        """What ``convert`` makes of a frame as FFmpeg decoded it (av.VideoFrame), in one thread at
        a time: PyAV changes a frame while it converts it. Raises InputError if missing or damaged.
        """
        if not 0 <= number < len(self.index.pts):
            raise InputError(f"{self.path}: holds no frame {number}, but {len(self.index.pts)}")
        pts = int(self.index.pts[number])
        with self._lock:
            for back_s in BACK_S:
                if pts in self._kept or self._found(pts, back_s):
                    return convert(self._kept[pts])
        raise InputError(
            f"{self.path}: frame {number}, at {pts * self.index.unit_s:.3f} s, cannot be decoded"
        )

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes about the file for the user."""
        notes = []
        length_s = float(self.index.times_s[-1] - self.index.times_s[0])
        if self.index.stated_s - length_s > LOST_S:
            notes.append(
                f"{self.path}: ends after {length_s:.1f} of {self.index.stated_s:.1f} s: it was cut"
            )
        with suppress(InputError):  # its pair says so
            if self.read(0, lambda frame: frame.interlaced_frame):
                notes.append(
                    f"{self.path}: is interlaced: its rows were exposed at two moments; "
                    "deinterlace it first"
                )
        if other := self.other_colors:
            notes.append(
                f"{self.path}: states {other}, but is read as sRGB: colors will be wrong; record "
                "or export it in BT.709 (standard dynamic range)"
            )
        return tuple(notes)

    def other_pixels(self, K: NDArray[np.float64]) -> str:
        """A note where the file states pixels of another shape than a calibration has; else ""."""
        wide = self.index.pixel_width
        with suppress(InputError):  # its pair says so
            if round(self.read(0, lambda frame: frame.rotation) / 90) % 2:
                wide = 1 / wide
        if wide == 1 or abs(K[0, 0] / K[1, 1] * wide - 1) < SAME_SHAPE:
            return ""
        return (
            f"{self.path}: states pixels {wide:.4g} times as wide as high (sample aspect ratio), "
            f"so that fx / fy would be {1 / wide:.3f}, but the calibration has "
            f"{K[0, 0] / K[1, 1]:.3f}: is it of frames that were stretched for display? Frames are "
            "read as they are stored: calibrate with such frames"
        )

    @property
    def other_colors(self) -> str:
        """What a file states that its values are, where that is not near sRGB; else ""."""
        with suppress(InputError):  # its pair says so
            curve, primaries = self.read(0, lambda frame: (frame.color_trc, frame.color_primaries))
            stated = CURVES.get(curve, ""), PRIMARIES.get(primaries, "")
            return " and ".join(part for part in stated if part)
        return ""

    def _found(self, pts: int, back_s: float) -> bool:
        """Decode on, or from ``back_s`` before the frame, until it is kept; False where the video
        goes past it.
        """
        if back_s or not self._is_near(pts):
            self._frames = self._from(pts - round(back_s / self.index.unit_s))
        for frame in self._frames:
            if frame.pts is None:
                continue
            self._last = frame.pts
            self._kept.keep(frame.pts, frame)
            if frame.pts >= pts:
                return bool(frame.pts == pts)
        self._last = None
        return False

    def _is_near(self, pts: int) -> bool:
        """Whether the decoder comes to the frame soon: with no keyframe before it."""
        if self._last is None or self._last >= pts:
            return False
        index = self.index
        return bool(
            bisect_right(index.keys, self._last) == bisect_right(index.keys, pts)
            or np.searchsorted(index.pts, pts) - np.searchsorted(index.pts, self._last)
            <= NEAR_FRAMES
        )

    def _from(self, pts: int) -> Iterator[Any]:
        with opened(self.path) as container:
            stream = video_stream(container, self.path)
            if pts > self.index.pts[0]:
                container.seek(pts, stream=stream)
            yield from decoded(container, stream)


def video_file(path: Path) -> VideoFile:
    """The video, opened once while its file stays the same. Raises InputError, DeviceError."""
    try:
        status = path.stat()
    except OSError as error:
        raise InputError(f"{path}: the video cannot be read: {error.strerror}") from error
    return _video_file(path, status.st_size, status.st_mtime_ns)


@lru_cache(OPEN_VIDEOS)
def _video_file(path: Path, size: int, mtime_ns: int) -> VideoFile:
    return VideoFile(path)


def _frame_index(path: Path) -> VideoIndex:
    """Times of all frames as the file states them."""
    with opened(path) as container:
        stream = video_stream(container, path)
        first = [frame.pts or 0 for frame in islice(decoded(container, stream), ORDER_FRAMES)]
        if first != sorted(first):  # of an AVI
            raise InputError(
                f"{path}: does not store the times of reordered frames (B-frames): convert it to "
                ".mp4 or .mkv"
            )
    with opened(path) as container:
        stream = video_stream(container, path)
        pts, keys = [], []
        for packet in container.demux(stream):
            if packet.pts is not None and packet.size and not packet.is_discard:
                pts.append(packet.pts)
                keys += [packet.pts] if packet.is_keyframe else []
        if not pts:
            raise InputError(f"{path}: holds no frame with a time")
        # AV_TIME_BASE
        stated_s = (
            float(stream.duration * stream.time_base)
            if stream.duration
            else (container.duration or 0) / 1e6
        )
        return VideoIndex(
            np.unique(pts),
            np.unique(np.array(keys, np.int64)),
            float(stream.time_base),
            stated_s,
            float(stream.sample_aspect_ratio or 1),
        )
