"""A run as one MCAP file: corrected images, ranges, points, track, with the inputs' stamps."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.extras.export.export_format import ExportFormat
from stereo_seecolor.extras.export.images_of_8_bits import READABLE
from stereo_seecolor.extras.streams.mcap_recording import McapRecording, RecordedPair
from stereo_seecolor.files.decode import eight_bit
from stereo_seecolor.files.encode import encode_image
from stereo_seecolor.run_folder.finished_run import FinishedFrame
from stereo_seecolor.run_folder.posed_run import PosedRun

FILE = "dive.mcap"
_STAMP = re.compile(r"(?<!\d)(\d{10})-(\d{9})(?!\d)")
COUNTED_STEP_NS = 10**9
"""Frames without a time are stamped a second apart."""


def write(posed: PosedRun, folder: Path) -> None:
    """``dive.mcap``. Raises DeviceError without a library, InputError for a damaged frame."""
    with McapRecording(folder / FILE, posed.geometry) as recording:
        for i, frame in enumerate(posed.frames):
            pair = recorded(frame, i, posed.T_map_camera[i])
            recording.add(replace(pair, range_m=np.float32(posed.map.range_scale) * pair.range_m))


def recorded(
    frame: FinishedFrame, number: int, T_map_camera: NDArray[np.float64] | None
) -> RecordedPair:
    """A finished frame as it is recorded. Raises InputError if it is damaged."""
    pixels = frame.read("corrected")
    color, source = eight_bit(pixels), frame.products["corrected"]
    is_readable = source.suffix in READABLE and pixels.dtype == np.uint8
    picture = (
        (source.read_bytes(), source.suffix)
        if is_readable
        else (bytes(encode_image(color, "png")), ".png")
    )
    return RecordedPair(
        stamp_of(frame.name, frame.timestamp_s, number),
        picture,
        color,
        frame.measured_range_m(),
        T_map_camera,
    )


def stamp_of(name: str, timestamp_s: float | None, number: int) -> int:
    """Nanoseconds since 1970: exact where the name holds them, as those of bags do; of frames
    without time, a count of seconds.
    """
    if found := _STAMP.search(name):
        return int(found[1]) * 10**9 + int(found[2])
    return (number + 1) * COUNTED_STEP_NS if timestamp_s is None else round(timestamp_s * 1e9)


FORMAT = ExportFormat(
    "corrected images, ranges, points, camera and track as ROS 2 messages in one file",
    "Foxglove, RViz, ROS 2",
    write,
)
