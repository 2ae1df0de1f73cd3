"""ROS 2 topics without ROS, by Cyclone DDS, with the types of rosbags. Messages are handled as CDR
bytes, as ROS 2 sends them.

Names as ROS 2 maps them: topic ``/a`` is ``rt/a``, type ``sensor_msgs/msg/Image`` is
``sensor_msgs::msg::dds_::Image_`` (https://design.ros2.org/articles/topic_and_service_names.html).
"""

import os
import time
import types
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, Literal

from stereo_seecolor.config import InputConfig
from stereo_seecolor.errors import DeviceError, library_for
from stereo_seecolor.extras.streams.bags.bag import COMPRESSED, IMAGE
from stereo_seecolor.extras.streams.bags.messages import message_content, store
from stereo_seecolor.extras.streams.live.streams import Arrived, ImageStream
from stereo_seecolor.inputs.images import decode_image
from stereo_seecolor.records import Image

PREFIX = "ros2:"
"""Beginning of a topic in place of a folder: ``--left ros2:/stereo/left/image_raw``."""

HISTORY = 8
"""Messages of a topic that the middleware keeps while a pair is processed."""


class Node:
    """A participant of the domain ROS_DOMAIN_ID (0). Raises DeviceError if Cyclone DDS is missing,
    or cannot use the network.
    """

    def __init__(self) -> None:
        with library_for("a ROS 2 topic", "ros2"):
            from cyclonedds.core import DDSException
            from cyclonedds.domain import DomainParticipant

            store("cdr")
        try:
            self._participant = DomainParticipant(int(os.environ.get("ROS_DOMAIN_ID") or 0))
        except (DDSException, ValueError) as error:
            raise DeviceError(
                f"ROS 2 topics cannot be reached: {error}: is ROS_DOMAIN_ID a number of a domain?"
            ) from error
        self._writers: dict[str, Any] = {}

    def reader(self, topic: str, msgtype: str) -> Any:
        """A reader of a topic, for reliable and best-effort writers."""
        from cyclonedds.sub import DataReader

        return DataReader(self._participant, self._topic(topic, msgtype), qos=_qos(reliable=False))

    def publish(self, topic: str, msgtype: str, content: bytes) -> None:
        """Send a serialized message, reliably to readers that ask for reliability."""
        from cyclonedds.pub import DataWriter

        if topic not in self._writers:
            self._writers[topic] = DataWriter(
                self._participant, self._topic(topic, msgtype), qos=_qos(reliable=True)
            )
        sample = _of_cdr(_idl_type(msgtype), content)
        self._writers[topic].write(sample)

    def _topic(self, topic: str, msgtype: str) -> Any:
        from cyclonedds.topic import Topic

        return Topic(self._participant, f"rt/{topic.lstrip('/')}", _idl_type(msgtype))


class TopicImages(ImageStream):
    """A stream of the images of one topic; ``.../compressed`` is sensor_msgs/CompressedImage, all
    others are sensor_msgs/Image.
    """

    def __init__(self, node: Node, topic: str, config: InputConfig) -> None:
        super().__init__(f"{PREFIX}{topic}")
        self._config = config
        self._msgtype = COMPRESSED if topic.endswith("/compressed") else IMAGE
        self._reader = node.reader(topic, self._msgtype)

    def receive(self) -> None:
        """Add the images that have arrived. ``waiting`` names a topic that nobody publishes."""
        for sample in self._reader.take(N=HISTORY):
            content = getattr(sample, "cdr", b"")
            if len(content) < 12:
                continue
            message = partial(_image, bytes(content), self._msgtype, self.name, self._config)
            self.add(Arrived(_stamp_ns(content) or time.time_ns(), time.monotonic(), message))
        self.waiting = (
            "" if self._reader.get_subscription_matched_status().current_count else self.name
        )


def _image(content: bytes, msgtype: str, name: str, config: InputConfig) -> Image:
    message = store("cdr").deserialize_cdr(content, msgtype)
    return decode_image(message_content(message, msgtype, name), Path(name), config)


def _stamp_ns(content: bytes) -> int:
    """The stamp in a message's header, which comes first; the second byte gives the byte order."""
    order: Literal["little", "big"] = "little" if content[1] & 1 else "big"
    seconds, nanoseconds = (int.from_bytes(content[start : start + 4], order) for start in (4, 8))
    return seconds * 10**9 + nanoseconds


def _qos(reliable: bool) -> Any:
    from cyclonedds.core import Policy, Qos
    from cyclonedds.util import duration

    kind = (
        Policy.Reliability.Reliable(duration(milliseconds=100))
        if reliable
        else Policy.Reliability.BestEffort
    )
    form = Policy.DataRepresentation(use_cdrv0_representation=True, use_xcdrv2_representation=False)
    return Qos(kind, Policy.History.KeepLast(HISTORY), form)


def _serialized(sample: Any, *_: Any, **__: Any) -> bytes:
    return bytes(sample.cdr)


def _of_cdr(type_: Any, data: bytes, *_: Any, **__: Any) -> Any:
    sample = type_.__new__(type_)
    sample.cdr = data
    return sample


@lru_cache
def _idl_type(msgtype: str) -> Any:
    """The IDL type of a ROS type, from rosbags' definition. Its samples hold the serialized
    message, in ``cdr``.
    """
    from cyclonedds.idl import IdlStruct

    package, _, short = msgtype.split("/")
    fields = {name: _idl_field(*kind) for name, kind in store("cdr").fielddefs[msgtype][1]}
    content = {
        "__annotations__": fields,
        "serialize": _serialized,
        "deserialize": classmethod(_of_cdr),
    }
    typename = f"{package}.msg.dds_.{short}_"
    return dataclass(
        types.new_class(
            f"{short}_", (IdlStruct,), {"typename": typename}, lambda own: own.update(content)
        )
    )


def _idl_field(kind: Any, of: Any) -> Any:
    import cyclonedds.idl.types as idl_types
    from rosbags.interfaces import Nodetype

    idl: Any = idl_types

    if kind == Nodetype.BASE:
        plain = {
            "bool": bool,
            "string": str,
            "byte": idl.uint8,
            "char": idl.uint8,
            "octet": idl.uint8,
        }
        return plain.get(of[0]) or getattr(idl, of[0])
    if kind == Nodetype.NAME:
        return _idl_type(of)
    inner, count = _idl_field(*of[0]), of[1]
    return idl.array[inner, count] if kind == Nodetype.ARRAY else idl.sequence[inner]
