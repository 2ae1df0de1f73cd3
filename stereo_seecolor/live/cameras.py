"""Capture devices and network streams, by OpenCV: each is read by a thread of its own, and opened again when it has vanished."""

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.background import in_background
from stereo_seecolor.errors import DeviceError
from stereo_seecolor.live.streams import Arrivals, Arrived
from stereo_seecolor.records import Image

TIMEOUT_MS = 5000
"""A network camera that neither answers nor sends for so long has vanished."""

RETRY_S = 1.0
"""A camera that has vanished is opened again so often."""

FFMPEG_OPTIONS = "fflags;nobuffer|flags;low_delay|rtsp_transport;tcp"
"""Frames are shown as they come, instead of some seconds later; packets of RTSP are not lost."""

FFMPEG_QUIET = "-8"
"""AV_LOG_QUIET: a stream that is joined between two keyframes would fill the terminal with complaints."""


def is_address(text: str) -> bool:
    """True for a capture device (``0``, ``/dev/video0``), a network address, and a GStreamer pipeline (``... ! appsink``)."""
    return text.isdecimal() or text.startswith("/dev/video") or "://" in text or " ! " in text


class Camera:
    """What one address sends. name: the address. waiting: it, while it does not send; "" while it does."""

    def __init__(self, address: str) -> None:
        self.name = self.waiting = address
        self.images = Arrivals()
        self._is_stopped = False

    def run(self) -> None:
        """Read until ``stop``."""
        while not self._is_stopped:
            capture = _opened(self.name)
            while not self._is_stopped and capture.grab():
                arrived_s, stamp_ns = time.monotonic(), time.time_ns()
                found, image = capture.retrieve()
                if found:
                    self.images.add(Arrived(stamp_ns, arrived_s, partial(_rgb, image)))
                    self.waiting = ""
            self.waiting = self.name
            capture.release()
            until_s = time.monotonic() + RETRY_S
            while not self._is_stopped and time.monotonic() < until_s:
                time.sleep(RETRY_S / 20)

    def stop(self) -> None:
        """End soon."""
        self._is_stopped = True


class Side:
    """One side of a camera's picture: all of it, or its left or right half."""

    def __init__(self, camera: Camera, half: slice | None = None) -> None:
        self._camera, self._half = camera, half
        self.name = camera.name

    @property
    def waiting(self) -> str:
        """The camera's address, while it does not send."""
        return self._camera.waiting

    @property
    def newest(self) -> tuple[Arrived, ...]:
        """The last few, oldest first."""
        images = self._camera.images.newest
        return images if self._half is None else tuple(image._replace(image=partial(_half, image, self._half)) for image in images)

    @property
    def received(self) -> int:
        """How many came so far."""
        return self._camera.images.received


@contextmanager
def cameras(left: str, right: str) -> Iterator[tuple[Side, Side]]:
    """Read two addresses while the block runs; of the same address twice, the left and the right half of its picture.

    Raises DeviceError for a GStreamer pipeline where OpenCV was built without.
    """
    for address in (left, right):
        if " ! " in address and not cv2.videoio_registry.hasBackend(cv2.CAP_GSTREAMER):
            raise DeviceError(
                f"{address}: this OpenCV was built without GStreamer: install one that has it, or give an rtsp:// address"
            )
    os.environ.setdefault("OPENCV_FFMPEG_CAPTURE_OPTIONS", FFMPEG_OPTIONS)
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", FFMPEG_QUIET)
    first = Camera(left)
    with in_background(first.run, first.stop):
        if left == right:
            yield Side(first, slice(0, 1)), Side(first, slice(1, 2))
            return
        second = Camera(right)
        with in_background(second.run, second.stop):
            yield Side(first), Side(second)


def _opened(address: str) -> Any:
    if address.isdecimal():
        return cv2.VideoCapture(int(address))
    if " ! " in address:
        return cv2.VideoCapture(address, cv2.CAP_GSTREAMER)
    if "://" in address:
        limits = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, TIMEOUT_MS, cv2.CAP_PROP_READ_TIMEOUT_MSEC, TIMEOUT_MS]
        return cv2.VideoCapture(address, cv2.CAP_FFMPEG, limits)
    return cv2.VideoCapture(address)


def _rgb(image: NDArray[np.uint8]) -> Image:
    rgb: Image = cv2.cvtColor(image, cv2.COLOR_GRAY2RGB if image.ndim == 2 else cv2.COLOR_BGR2RGB)
    return rgb


def _half(image: Arrived, which: slice) -> Image:
    """which: slice(0, 1) is the left half, slice(1, 2) the right one."""
    whole = image.image()
    width = whole.shape[1] // 2
    half: Image = whole[:, which.start * width : which.stop * width].copy()
    return half
