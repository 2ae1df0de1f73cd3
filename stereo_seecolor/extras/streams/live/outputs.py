"""The outputs of ``live``: files in a folder, a recording, and ROS 2 topics."""

from collections.abc import Callable
from itertools import count
from pathlib import Path

from calibration import RectifiedPair
from stereo_seecolor.errors import OutputError
from stereo_seecolor.extras.streams import ros_messages as ros
from stereo_seecolor.extras.streams.live.processing import LiveFrame
from stereo_seecolor.extras.streams.live.ros2 import Node
from stereo_seecolor.extras.streams.mcap_recording import (
    TOPICS,
    McapRecording,
    RecordedPair,
    messages,
)
from stereo_seecolor.extras.streams.recording import stamp_of
from stereo_seecolor.files.atomic import write_atomic
from stereo_seecolor.files.decode import eight_bit
from stereo_seecolor.files.encode import encode_image
from stereo_seecolor.pipeline import Pipeline
from stereo_seecolor.run_folder.pair_files import Files, correction_files, range_files

FIRST = ("range", "clouds")
"""Products that are written before the others."""


class KeptFiles:
    """Writes every ``every``th pair into ``folder``. Raises OutputError if it is not empty."""

    def __init__(self, folder: Path, every: int, pipeline: Pipeline) -> None:
        if folder.exists() and any(folder.iterdir()):
            raise OutputError(
                f"{folder}: already exists: live saves its results in a new or an empty folder; "
                "nothing was changed"
            )
        self._folder, self._every, self._pipeline = folder, every, pipeline
        self._seen = 0

    def __call__(self, frame: LiveFrame) -> None:
        """Write a pair's products. Raises OutputError."""
        self._seen += 1
        if (self._seen - 1) % self._every:
            return
        files, number = self._files(frame, frame.pair.name), 1
        # a camera that was started again may count from one again
        while any((self._folder / path).exists() for path, _ in files.values()):
            number += 1
            files = self._files(frame, f"{frame.pair.name}~{number}")
        for product in sorted(files, key=lambda product: product not in FIRST):
            path, content = files[product]
            write_atomic(self._folder / path, content)

    def _files(self, frame: LiveFrame, name: str) -> Files:
        output, result = self._pipeline.config.output, frame.result
        return range_files(name, result.range_map, output) | correction_files(
            name, result.correction, result.range_map, self._pipeline.geometry, output, b""
        )


def published(namespace: str, geometry: RectifiedPair) -> Callable[[LiveFrame], None]:
    """A function that publishes a pair as ROS 2 topics, named as those of a recording, with
    ``namespace`` instead of /stereo.

    Raises DeviceError where ROS 2 topics cannot be published here.
    """
    node, numbers, prefix = Node(), count(), "/" + namespace.strip("/")

    def send(frame: LiveFrame) -> None:
        for topic, message in messages(recorded_live(frame, next(numbers)), geometry):
            name = TOPICS[topic]
            node.publish(
                topic.replace("/stereo", prefix, 1),
                ros.type_name(name),
                ros.serialize(name, message),
            )

    return send


def recorder(file: McapRecording) -> Callable[[LiveFrame], None]:
    """A function that adds a pair to a recording, its image as JPEG; raises OutputError."""
    numbers = count()
    return lambda frame: file.add(recorded_live(frame, next(numbers)))


def recorded_live(frame: LiveFrame, number: int) -> RecordedPair:
    """A pair for a recording or topics. number: of the pair, for a stamp where it has none."""
    color = eight_bit(frame.result.correction.image)
    stamp_ns = stamp_of(frame.pair.name, frame.pair.timestamp_s, number)
    return RecordedPair(
        stamp_ns,
        (bytes(encode_image(color, "jpg")), ".jpg"),
        color,
        frame.result.range_map.measured_m,
    )
