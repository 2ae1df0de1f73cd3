"""Videos in bags (H.264, H.265): each picture with the stamp of its message, and what cannot be
decoded is named.
"""

import base64
import json
from collections.abc import Iterable, Sequence
from fractions import Fraction
from functools import cache

import av
import cv2
import numpy as np
import pytest
from bag_writers import (
    LEFT,
    PACKET,
    RIGHT,
    START_NS,
    STEP_NS,
    VIDEO,
    Sent,
    camera_infos,
    coded_picture,
    name_by_stamps,
    stamp_of,
    write_bag,
)
from mcap.writer import Writer

from stereo_seecolor.config import InputConfig
from stereo_seecolor.errors import DeviceError, InputError
from stereo_seecolor.extras.streams.bags.coded_units import H264, Units, codec_of
from stereo_seecolor.extras.streams.bags.dive import open_dive
from stereo_seecolor.inputs.images import read_image

SIZE = (96, 64)
FRAMES = 24
GROUP = 8
IMAGE = "sensor_msgs/msg/CompressedImage"
Packets = Sequence[tuple[int, bytes]]
"""In the order of coding: the number of the frame, and what is sent."""


def drawn(number: int, side: str) -> np.ndarray:
    """A frame that no other one is like: its number in bars, over a texture that moves."""
    rng = np.random.default_rng(3)
    texture = cv2.resize(rng.uniform(60, 200, (24, 40)).astype(np.float32), (200, 80))
    image = np.dstack([texture[: SIZE[1], 2 * number : 2 * number + SIZE[0]]] * 3)
    for bit in range(5):
        image[:12, 16 * bit : 16 * bit + 16] = 230 if number >> bit & 1 else 20
    image[-12:] = 230 if side == "left" else 20
    return image.astype(np.uint8)


@cache
def coded(side: str = "left", b_frames: int = 0, encoder: str = "libx264") -> Packets:
    """The frames in H.264 or H.265, a keyframe every GROUP frames."""
    return encoded([drawn(number, side) for number in range(FRAMES)], b_frames, encoder)


def encoded(frames: Iterable[np.ndarray], b_frames: int = 0, encoder: str = "libx264") -> Packets:
    frames = list(frames)
    context = av.CodecContext.create(encoder, "w")
    context.height, context.width = frames[0].shape[:2]
    context.pix_fmt, context.time_base = "yuv444p", Fraction(1, 10)
    context.options = {"crf": "8", "bf": str(b_frames), "g": str(GROUP), "threads": "1"}
    if encoder == "libx265":
        chosen = f"bframes={b_frames}:keyint={GROUP}:min-keyint={GROUP}:repeat-headers=1"
        context.options = {
            "crf": "8",
            "x265-params": f"{chosen}:log-level=none:pools=none:frame-threads=1",
        }
    packets = []
    for number, rgb in enumerate(frames):
        frame = av.VideoFrame.from_ndarray(rgb, format="rgb24")
        frame.pts = number
        packets += context.encode(frame)
    return [(packet.pts, bytes(packet)) for packet in (*packets, *context.encode(None))]


def sent(
    packets: Packets,
    topic: str = f"{LEFT}/image_raw/h264",
    suffix: str = ".mcap",
    kind: str = VIDEO,
) -> list[Sent]:
    """Messages in the order of coding, each with the stamp of its frame."""
    return [
        coded_picture(
            suffix, kind, topic, START_NS + number * STEP_NS, content, START_NS + i * STEP_NS
        )
        for i, (number, content) in enumerate(packets)
    ]


def both(left: Packets, right: Packets, suffix: str = ".mcap", kind: str = VIDEO) -> list[Sent]:
    messages = [
        message
        for camera, packets in ((LEFT, left), (RIGHT, right))
        for message in sent(packets, f"{camera}/image_raw/h264", suffix, kind)
    ]
    return sorted(messages, key=lambda message: message.arrival_ns)


def check_pictures(pairs, numbers: Iterable[int]) -> None:
    """Each pair's images are the frames of its stamp."""
    assert [pair.name for pair in pairs] == [name_of(number) for number in numbers]
    for pair, number in zip(pairs, numbers, strict=True):
        for side, path in (("left", pair.left), ("right", pair.right)):
            off = np.abs(read_image(path).astype(int) - drawn(number, side))
            assert off.mean() < 3, (number, side)


def name_of(number: int) -> str:
    seconds, nanoseconds = divmod(START_NS + number * STEP_NS, 10**9)
    return f"{seconds:010d}-{nanoseconds:09d}"


@pytest.mark.parametrize(
    ("suffix", "kind"),
    [
        (".mcap", VIDEO),
        (".db3", PACKET),
        (".mcap", IMAGE),
        (".bag", VIDEO),
        (".bag", PACKET),
        (".bag", IMAGE),
    ],
)
def test_each_picture_has_the_stamp_of_its_message(suffix, kind, tmp_path) -> None:
    bag = write_bag(tmp_path / f"b{suffix}", both(coded("left"), coded("right"), suffix, kind))
    dive = open_dive(bag, "", InputConfig())
    assert not [note for note in dive.pairing.notes if "left out" in note]
    check_pictures(dive.pairing.pairs, range(FRAMES))
    check_pictures(dive.pairing.pairs[::-5], range(FRAMES)[::-5])  # in any order


@pytest.mark.parametrize(("encoder", "b_frames"), [("libx264", 2), ("libx265", 0), ("libx265", 2)])
def test_pictures_that_are_sent_out_of_order(encoder, b_frames, tmp_path) -> None:
    left, right = (coded(side, b_frames, encoder) for side in ("left", "right"))
    assert b_frames == 0 or [number for number, _ in left] != sorted(number for number, _ in left)
    messages = [
        message._replace(
            fields={**message.fields, "format": "h265" if encoder == "libx265" else "H.264"}
        )
        for message in both(left, right)
    ]
    pairs = open_dive(write_bag(tmp_path / "b.mcap", messages), "", InputConfig()).pairing.pairs
    check_pictures(pairs, range(FRAMES))
    check_pictures(pairs[::-5], range(FRAMES)[::-5])


def test_pictures_before_the_first_keyframe_are_named_and_left_out(tmp_path) -> None:
    bag = write_bag(tmp_path / "b.mcap", both(coded("left")[3:], coded("right")))
    pairing = open_dive(bag, "", InputConfig()).pairing
    (note,) = [note for note in pairing.notes if "keyframe" in note]
    assert note == (
        f"{bag}: {LEFT}/image_raw/h264: 5 of 21 pictures come before its first keyframe: left out"
    )
    check_pictures(pairing.pairs, range(GROUP, FRAMES))


@pytest.mark.parametrize("b_frames", [0, 2])
def test_pictures_that_build_on_a_missing_message_are_left_out(b_frames, tmp_path) -> None:
    """A decoder gives pictures for these, too: with parts of what was there before."""
    left = list(coded("left", b_frames))
    gone, _ = left.pop(9)
    assert gone == (11 if b_frames else 9)
    bag = write_bag(tmp_path / "b.mcap", both(left, coded("right", b_frames)))
    pairing = open_dive(bag, "", InputConfig()).pairing
    after = {number for number, _ in left[9:] if number < 2 * GROUP}
    (note,) = [note for note in pairing.notes if "depend on" in note]
    assert f"{len(after)} of {FRAMES - 1} pictures depend on a missing one" in note
    check_pictures(pairing.pairs, [n for n in range(FRAMES) if n not in after | {gone}])


@pytest.mark.parametrize(("kind", "b_frames"), [("cut", 0), ("cut", 2), ("missing", 0)])
def test_damaged_pictures_are_named_up_to_the_next_keyframe(kind, b_frames, tmp_path) -> None:
    """In H.264 one of which half is missing; in H.265 the decoder misses one that others need."""
    encoder, form = ("libx264", "h264") if kind == "cut" else ("libx265", "hevc")
    left = list(coded("left", b_frames, encoder))
    number, content = left.pop(9)
    if kind == "cut":
        left.insert(9, (number, content[: len(content) // 2]))
    messages = [
        message._replace(fields={**message.fields, "format": form})
        for message in both(left, coded("right", b_frames, encoder))
    ]
    pairs = open_dive(write_bag(tmp_path / "b.mcap", messages), "", InputConfig()).pairing.pairs
    damaged = []
    for pair in pairs:
        try:
            read_image(pair.left)
        except InputError as error:
            assert "h264: the picture of" in str(error)
            assert "cannot be decoded" in str(error)
            damaged.append(pair)
    after = {name_of(number) for number, _ in left[9:] if number < 2 * GROUP}
    assert after <= {pair.name for pair in damaged} <= {name_of(i) for i in range(7, 16)}
    assert len(damaged) <= len(after) + 1  # a decoder may hold one back when it fails
    right = [pair for pair in pairs if pair not in damaged]
    names = [name_of(number) for number in range(FRAMES)]
    check_pictures(right, [names.index(pair.name) for pair in right])


def test_a_bag_without_a_keyframe_is_one_line(cli, tmp_path) -> None:
    bag = write_bag(tmp_path / "b.mcap", both(coded("left")[1:GROUP], coded("right")[1:GROUP]))
    with pytest.raises(InputError, match=r"none of its 7 messages is a keyframe") as raised:
        open_dive(bag, "", InputConfig())
    assert "\n" not in str(raised.value)
    assert cli("run", "--bag", bag, "--out", tmp_path / "out")[0] == 1
    code, printed, said = cli("bag-info", bag)
    assert code == 3
    assert "keyframe" in printed + said


def test_another_codec_is_named(tmp_path) -> None:
    messages = [
        message._replace(fields={**message.fields, "format": "av1"})
        for message in both(coded("left")[:2], coded("right")[:2])
    ]
    with pytest.raises(InputError, match=r"is coded as 'av1': H\.264 and H\.265 are read"):
        open_dive(write_bag(tmp_path / "b.mcap", messages), "", InputConfig())


def test_parameters_that_come_in_a_message_of_their_own(tmp_path) -> None:
    """With the stamp of the keyframe that follows, which is not taken for a second one."""
    apart: list[tuple[int, bytes]] = []
    for number, content in coded("left"):
        key = content.rfind(b"\0\0\1\x65")
        apart += (
            [(number, content)] if key < 0 else [(number, content[:key]), (number, content[key:])]
        )
    assert len(apart) == FRAMES + FRAMES // GROUP
    bag = write_bag(tmp_path / "b.mcap", both(apart, coded("right")))
    pairing = open_dive(bag, "", InputConfig()).pairing
    assert not [note for note in pairing.notes if "left out" in note]
    check_pictures(pairing.pairs, range(FRAMES))


def test_parameters_that_come_once(tmp_path) -> None:
    """Before the first keyframe alone."""
    once = [
        (number, content[max(content.rfind(b"\0\0\1\x65"), 0) :] if number else content)
        for number, content in coded("left")
    ]
    bag = write_bag(tmp_path / "b.mcap", both(once, coded("right")))
    check_pictures(open_dive(bag, "", InputConfig()).pairing.pairs[::-5], range(FRAMES)[::-5])


@pytest.mark.slow
def test_a_video_that_goes_on_in_the_next_file_of_a_split_bag(tmp_path, monkeypatch) -> None:
    folder = tmp_path / "split"
    folder.mkdir()
    messages = both(coded("left"), coded("right"))
    for i, part in enumerate((messages[:22], messages[22:])):
        write_bag(tmp_path / f"part{i}.mcap", part).rename(folder / f"b_{i}.mcap")
    pairs = open_dive(folder, "", InputConfig()).pairing.pairs
    check_pictures(pairs, range(FRAMES))
    monkeypatch.setattr("stereo_seecolor.files.contained._containers", {})  # as another process
    check_pictures(pairs[12:14], (12, 13))


@pytest.mark.parametrize("encoding", ["protobuf", "json"])
@pytest.mark.parametrize("name", ["foxglove.CompressedVideo", "foxglove.CompressedImage"])
def test_messages_of_foxglove_that_no_ros_wrote(encoding, name, tmp_path) -> None:
    path = tmp_path / "b.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema(
            name, "protobuf" if encoding == "protobuf" else "jsonschema", b""
        )
        for side in ("left", "right"):
            channel = writer.register_channel(f"/{side}/video", encoding, schema)
            for number, content in coded(side):
                stamp_ns = START_NS + number * STEP_NS
                write = _protobuf if encoding == "protobuf" else _json
                writer.add_message(channel, stamp_ns + 1, write(name, stamp_ns, content), stamp_ns)
        writer.finish()
    check_pictures(open_dive(path, "", InputConfig()).pairing.pairs, range(FRAMES))


def _json(_: str, stamp_ns: int, content: bytes) -> bytes:
    seconds, nanoseconds = divmod(stamp_ns, 10**9)
    data = base64.b64encode(content).decode()
    message = {"timestamp": {"sec": seconds, "nsec": nanoseconds}, "frame_id": "c"}
    return json.dumps({"data": data, "format": "h264", **message}).encode()


def _protobuf(name: str, stamp_ns: int, content: bytes) -> bytes:
    """The message in the fields' order, as writers do; Timestamp: seconds, nanoseconds."""
    seconds, nanoseconds = divmod(stamp_ns, 10**9)
    time = b"\x08" + _varint(seconds) + b"\x10" + _varint(nanoseconds)
    numbers = (2, 3, 4) if name.endswith("Video") else (4, 2, 3)  # frame_id, data, format
    fields = dict(zip(numbers, (b"camera", content, b"h264"), strict=True))
    return b"".join(
        _varint(number << 3 | 2) + _varint(len(value)) + value
        for number, value in sorted({1: time, **fields}.items())
    )


def _varint(value: int) -> bytes:
    parts = []
    while value > 127:
        parts.append(value & 127 | 128)
        value >>= 7
    return bytes([*parts, value])


def test_a_missing_library_is_named_before_the_run(tmp_path, monkeypatch) -> None:
    import sys

    bag = write_bag(tmp_path / "b.mcap", both(coded("left"), coded("right")))
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(DeviceError, match=r"a video needs .*av.*: pip install .*\[video\]"):
        open_dive(bag, "", InputConfig())


def test_codecs_by_their_names() -> None:
    named = (
        "libx264",
        "H264",
        "h264_nvenc;nv12;bgr8;bgr8",
        "avc",
        "H.265",
        "hevc_vaapi",
        "jpeg",
        "",
    )
    assert [codec_of(name) for name in named] == [*["h264"] * 4, "hevc", "hevc", "", ""]


def test_bytes_of_any_kind_are_looked_at_without_an_error() -> None:
    rng = np.random.default_rng(0)
    parameters = coded("left")[0][1]
    for size in range(1, 200):
        units = Units(H264)
        units.look(parameters[:size])
        units.look(b"\0\0\1" + rng.bytes(size))
        units.look(b"\0\0\1\x67" + rng.bytes(size % 12))
        units.look(b"\0\0\1\x41" + bytes(size % 3))


@pytest.mark.slow
def test_a_run_of_a_video_in_a_bag_is_that_of_its_frames(make_dive, cli, tmp_path) -> None:
    """A side's damaged frame leaves its pair out, with exit code 3."""
    dive = make_dive(4)
    name_by_stamps(dive.root)
    messages = camera_infos(dive.root / "cam.yaml")
    for side, camera in (("L", LEFT), ("R", RIGHT)):
        files = sorted((dive.root / side).glob("*.png"))
        frames = [cv2.imread(str(file), cv2.IMREAD_COLOR_RGB) for file in files]
        for (number, content), file in zip(encoded(frames), files, strict=True):
            damaged = content[: len(content) // 2] if (side, number) == ("R", 3) else content
            messages.append(
                coded_picture(".mcap", VIDEO, f"{camera}/image_raw/h264", stamp_of(file), damaged)
            )
    bag = write_bag(tmp_path / "b.mcap", messages)
    code, printed, said = cli("run", "--bag", bag, "--out", tmp_path / "out")
    assert code == 3, said
    assert said.count("failed: 1700000000-873456789") == 1
    assert len(list((tmp_path / "out/range").iterdir())) == 3
    code, printed, said = cli("bag-info", bag)
    assert code == 0, said
    assert "4 pairs" in printed
