"""A video's frames by their numbers: an index of their times, and each decoded from the keyframe
before it; and the streams beside the colors: gray pictures, sound, time code. By PyAV (FFmpeg).
"""

from bisect import bisect_right
from collections import OrderedDict
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.threads import Lock
from stereo_seecolor.errors import DeviceError, InputError
from stereo_seecolor.files.whole_files import special_kind
from stereo_seecolor.inputs.decoding import MAX_PIXELS

SOUND_RATE_HZ = 8000
"""Enough for voices, clicks and motors; a sample is 0.1 ms."""


def video_library() -> Any:
    """PyAV. Raises DeviceError if it is missing."""
    try:
        import av
    except ImportError as error:
        raise DeviceError(
            "videos need a library that is missing (av): pip install -c constraints.txt '.[video]'"
        ) from error
    return av


@contextmanager
def opened(path: Path) -> Iterator[Any]:
    """The container of a video. Raises InputError if it cannot be opened or read, DeviceError if
    PyAV is missing.
    """
    av = video_library()
    try:
        if kind := special_kind(path):
            raise InputError(f"{path}: is {kind}, not a video")
        with av.open(str(path), metadata_errors="ignore") as container:
            yield container
    except (av.FFmpegError, OSError) as error:
        raise InputError(
            f"{path}: is not a video that FFmpeg can read: {error.strerror or error}"
        ) from error


def video_stream(container: Any, path: Path) -> Any:
    """The stream of pictures. Raises InputError if there is none, it cannot be decoded, or claims
    to be too large.
    """
    stream = container.streams.best("video")  # not a cover picture
    if stream is None:
        raise InputError(f"{path}: holds no video frames")
    if stream.codec_context is None:
        raise InputError(f"{path}: FFmpeg does not know the codec of its frames")
    if stream.width * stream.height > MAX_PIXELS:
        raise InputError(f"{path}: claims pictures of {stream.width}x{stream.height} px: not read")
    stream.thread_type = "AUTO"
    return stream


def gray_frames(path: Path) -> Iterator[tuple[float, NDArray[np.uint8]]]:
    """Each frame's time in seconds on the file's own clock, and the frame in gray, upright.

    A damaged frame ends it. Raises InputError if there is none, DeviceError.
    """
    count = 0
    with opened(path) as container:
        for frame in decoded(container, video_stream(container, path)):
            if frame.pts is None:
                continue
            yield float(frame.pts * frame.time_base), gray(frame)
            count += 1
    if not count:
        raise InputError(f"{path}: holds no frame that can be decoded")


def gray(frame: Any) -> NDArray[np.uint8]:
    """Convert a decoded frame to gray, (H, W), turned as the file says that players are to
    turn it.
    """
    return np.rot90(frame.to_ndarray(format="gray"), round(frame.rotation / 90))


def sound(path: Path) -> tuple[float, NDArray[np.float32]]:
    """Read the time at which the sound begins on the file's own clock, seconds, and its samples at
    SOUND_RATE_HZ; none where it is silent or absent.

    Raises InputError, DeviceError.
    """
    with opened(path) as container:
        if not container.streams.audio:
            return 0.0, np.zeros(0, np.float32)
        import av

        resampler = av.AudioResampler(format="flt", layout="mono", rate=SOUND_RATE_HZ)
        start_s, parts = None, []
        for frame in decoded(container, container.streams.audio[0]):
            if start_s is None and frame.pts is not None:
                start_s = float(frame.pts * frame.time_base)
            parts += [np.asarray(piece.to_ndarray()).ravel() for piece in resampler.resample(frame)]
        return start_s or 0.0, np.concatenate(parts).astype(np.float32) if parts else np.zeros(
            0, np.float32
        )


def recorded_at(path: Path) -> float | None:
    """Read when a recording began by its camera's clock, seconds since 1970; None where the file
    does not say.

    Cameras that write their local time are taken to be at UTC. Raises InputError, DeviceError.
    """
    with opened(path) as container:
        try:
            return (
                datetime.fromisoformat(container.metadata.get("creation_time", ""))
                .replace(tzinfo=UTC)
                .timestamp()
            )
        except ValueError:
            return None


def decoded(container: Any, stream: Any) -> Iterator[Any]:
    """Frames up to the first that is damaged: what follows it would have times, but no pictures."""
    import av

    try:
        yield from container.decode(stream)
    except av.FFmpegError:
        return


KEPT_BYTES = 1 << 26
"""Decoded frames that are kept of a video: threads ask for frames near each other, and for each
more than once.
"""

NEAR_FRAMES = 8
"""A frame so few frames ahead is reached by decoding those between, also where a keyframe lies
between.
"""

BACK_S = (0.0, 1.0, 10.0)
"""How far before a frame decoding begins: pictures after the keyframe of an open group cannot be
decoded from it alone.
"""

LOST_S = 1.0
"""Sound may be longer than the pictures by less."""

OPEN_VIDEOS = 4

ORDER_FRAMES = 12
"""Of a video so many are decoded to see whether their times rise; codecs reorder at most some
frames.
"""

Times = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class VideoIndex:
    """The index of a video's frames.

    pts: (n,) times of the frames, rising, in units of unit_s seconds. keys: (k,) those of
    keyframes. stated_s: duration that the file states, 0 where it states none.
    """

    pts: Times
    keys: Times
    unit_s: float
    stated_s: float = 0.0

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


class VideoFile:
    """A video of whose frames each can be had by its number, from any thread. Raises InputError,
    DeviceError.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.index = _frame_index(path)
        self._lock = Lock()
        self._kept: OrderedDict[int, Any] = OrderedDict()
        self._frames: Iterator[Any] = iter(())
        self._last: int | None = None

    def frame(self, number: int) -> Any:
        """A frame as FFmpeg decoded it (av.VideoFrame). Raises InputError if there is none, or it
        is damaged.
        """
        if not 0 <= number < len(self.index.pts):
            raise InputError(f"{self.path}: holds no frame {number}, but {len(self.index.pts)}")
        pts = int(self.index.pts[number])
        with self._lock:
            for back_s in BACK_S:
                if pts in self._kept or self._found(pts, back_s):
                    return self._kept[pts]
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
            if self.frame(0).interlaced_frame:
                notes.append(
                    f"{self.path}: is interlaced: its rows were exposed at two moments; "
                    "deinterlace it first"
                )
        return tuple(notes)

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
            self._keep(frame)
            if frame.pts >= pts:
                return bool(frame.pts == pts)
        self._last = None
        return False

    def _is_near(self, pts: int) -> bool:
        """True if the decoder comes to the frame soon: there is no keyframe between, or hardly a
        frame.
        """
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

    def _keep(self, frame: Any) -> None:
        self._kept[frame.pts] = frame
        most = max(4, KEPT_BYTES // sum(plane.buffer_size for plane in frame.planes))
        while len(self._kept) > most:
            self._kept.popitem(last=False)


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
            np.unique(pts), np.unique(np.array(keys, np.int64)), float(stream.time_base), stated_s
        )
