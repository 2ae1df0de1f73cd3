"""Capture devices and network streams, by OpenCV; a thread reads each, and reopens it."""

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.background import running
from stereo_seecolor.errors import DeviceError
from stereo_seecolor.extras.streams.live.streams import Arrived, ImageStream
from stereo_seecolor.records import Image

TIMEOUT_MS = 5000
"""Milliseconds without an answer or an image after which a network camera counts as lost."""

RETRY_S = 1.0
"""Seconds between two attempts to open a lost camera again."""

FFMPEG_OPTIONS = "fflags;nobuffer|flags;low_delay|rtsp_transport;tcp"
"""Without buffers, which delay frames by seconds; RTSP over TCP, which loses no packets."""

FFMPEG_QUIET = "-8"
"""AV_LOG_QUIET: a stream joined between keyframes would fill the terminal with warnings."""


def is_address(text: str) -> bool:
    """True for a capture device (``0``, ``/dev/video0``), a network address, and a GStreamer
    pipeline (``... ! appsink``).
    """
    return text.isdecimal() or text.startswith("/dev/video") or "://" in text or " ! " in text


class LiveCamera:
    """The images of one address. sides: a stream of whole images, or two of their halves."""

    def __init__(self, address: str, sides: int = 1) -> None:
        self._address, self._is_stopped = address, False
        self.sides = tuple(ImageStream(address) for _ in range(sides))

    def run(self) -> None:
        """Read images until ``stop`` is called."""
        while not self._is_stopped:
            capture = _opened(self._address)
            while not self._is_stopped and capture.grab():
                arrived_s, stamp_ns = time.monotonic(), time.time_ns()
                found, image = capture.retrieve()
                if found:
                    for number, side in enumerate(self.sides):
                        side.add(
                            Arrived(
                                stamp_ns, arrived_s, partial(_part, image, number, len(self.sides))
                            )
                        )
            for side in self.sides:
                side.waiting = self._address
            capture.release()
            until_s = time.monotonic() + RETRY_S
            while not self._is_stopped and time.monotonic() < until_s:
                time.sleep(RETRY_S / 20)

    def stop(self) -> None:
        """Make ``run`` return soon."""
        self._is_stopped = True


@contextmanager
def cameras(left: str, right: str) -> Iterator[tuple[ImageStream, ImageStream]]:
    """Read two addresses while the block runs; for the same address twice, the left and right
    halves of its images.

    Raises DeviceError for a GStreamer pipeline where OpenCV was built without.
    """
    for address in (left, right):
        if " ! " in address and not cv2.videoio_registry.hasBackend(cv2.CAP_GSTREAMER):
            raise DeviceError(
                f"{address}: this OpenCV was built without GStreamer: install one that has it, or "
                "give an rtsp:// address"
            )
    os.environ.setdefault("OPENCV_FFMPEG_CAPTURE_OPTIONS", FFMPEG_OPTIONS)
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", FFMPEG_QUIET)
    if left == right:
        both = LiveCamera(left, sides=2)
        with running(both.run, both.stop):
            yield both.sides[0], both.sides[1]
        return
    first, second = LiveCamera(left), LiveCamera(right)
    with running(first.run, first.stop), running(second.run, second.stop):
        yield first.sides[0], second.sides[0]


def _opened(address: str) -> Any:
    if address.isdecimal():
        return cv2.VideoCapture(int(address))
    if " ! " in address:
        return cv2.VideoCapture(address, cv2.CAP_GSTREAMER)
    if "://" in address:
        limits = [
            cv2.CAP_PROP_OPEN_TIMEOUT_MSEC,
            TIMEOUT_MS,
            cv2.CAP_PROP_READ_TIMEOUT_MSEC,
            TIMEOUT_MS,
        ]
        return cv2.VideoCapture(address, cv2.CAP_FFMPEG, limits)
    return cv2.VideoCapture(address)


def _part(image: NDArray[np.uint8], number: int, count: int) -> Image:
    """(H, W, 3) RGB: view ``number`` of an image that shows ``count`` views side by side."""
    width = image.shape[1] // count
    rgb: Image = cv2.cvtColor(image, cv2.COLOR_GRAY2RGB if image.ndim == 2 else cv2.COLOR_BGR2RGB)
    return rgb if count == 1 else rgb[:, number * width : (number + 1) * width].copy()
