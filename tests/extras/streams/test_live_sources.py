"""Live sources: cameras and network streams (a server on this machine stands in for the device),
and topics of ROS 2.
"""

import platform
import re
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from fractions import Fraction
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any

import av
import cv2
import numpy as np
import pytest

from stereo_seecolor.config import InputConfig
from stereo_seecolor.errors import DeviceError, InputError
from stereo_seecolor.extras.streams.live import cameras as live_cameras
from stereo_seecolor.extras.streams.live import streams as live_streams
from stereo_seecolor.extras.streams.live.cameras import cameras
from stereo_seecolor.extras.streams.live.sources import live_source
from stereo_seecolor.extras.streams.live.streams import Arrived, ImageStream, StreamPairs


@contextmanager
def motion_jpeg(
    folders: dict[str, list[bytes]], rate_hz: float = 20.0, port: int = 0
) -> Iterator[int]:
    """What a network camera serves: ``/left`` and ``/right``, image after image; the port."""
    stopped = False

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            images = folders[self.path.strip("/")]
            self.send_response(200)
            self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
            self.end_headers()
            try:
                while not stopped:
                    image = images[int(time.time() * rate_hz) % len(images)]
                    head = (
                        "--frame\r\nContent-Type: image/jpeg\r\nContent-Length: "
                        f"{len(image)}\r\n\r\n".encode()
                    )
                    self.wfile.write(head + image + b"\r\n")
                    time.sleep(1 / rate_hz)
            except OSError:
                pass

        def log_message(self, format: str, *args: Any) -> None:
            pass

    ThreadingHTTPServer.allow_reuse_address = True
    server = ThreadingHTTPServer(("127.0.0.1", port), Handler)
    server.daemon_threads = True
    thread = Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield server.server_address[1]
    finally:
        stopped = True
        server.shutdown()
        server.server_close()
        thread.join(5)


def jpeg(image: np.ndarray) -> bytes:
    return bytes(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 95])[1])


def until(found: Callable[[], Any], seconds: float = 60.0) -> Any:
    """What ``found`` gives as soon as it gives something."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if value := found():
            return value
        time.sleep(0.02)
    raise AssertionError("nothing came")


@pytest.mark.slow
def test_two_network_cameras_become_pairs() -> None:
    images = {
        side: [jpeg(np.full((48, 64, 3), value, np.uint8))]
        for side, value in (("left", 60), ("right", 180))
    }
    with motion_jpeg(images) as port:
        addresses = [f"http://127.0.0.1:{port}/{side}" for side in images]
        with cameras(*addresses) as sides:
            source = StreamPairs(*sides, InputConfig())
            assert source.waiting == " and ".join(addresses)
            pair = until(source.newest)
            frame = source.read(pair)
            assert [round(side.mean(), -1) for side in (frame.left, frame.right)] == [60, 180]
            source.take(pair)
            later = until(source.newest)
            assert later.timestamp_s > pair.timestamp_s
            assert 0 <= source.latency_s(later) < 30


@contextmanager
def sent(address: str, values: tuple[int, ...], form: str) -> Iterator[None]:
    """H.264 of pictures of these gray values side by side, until the block ends; begun again where
    nobody listens yet.
    """
    stopped = False

    def send() -> None:
        with av.open(
            address, "w", format=form, options={"rtsp_transport": "tcp"} if form == "rtsp" else {}
        ) as container:
            stream = container.add_stream(
                "libx264", rate=20, options={"g": "5", "tune": "zerolatency"}
            )
            stream.width, stream.height, stream.pix_fmt = 64 * len(values), 48, "yuv420p"
            picture = np.repeat(
                np.repeat(np.array(values, np.uint8), 64)[None, :, None], 48, 0
            ).repeat(3, 2)
            for number in range(2000):
                frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
                frame.pts, frame.time_base = number, Fraction(1, 20)
                container.mux(stream.encode(frame))
                time.sleep(0.05)
                if stopped:
                    return

    def keep_sending() -> None:
        while not stopped:
            with suppress(OSError, av.FFmpegError):
                send()
            time.sleep(0.1)

    thread = Thread(target=keep_sending, daemon=True)
    thread.start()
    try:
        yield
    finally:
        stopped = True
        thread.join(10)


def free_port() -> int:
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


@pytest.mark.slow
@pytest.mark.parametrize("protocol", ["udp", "rtsp"])
def test_network_streams_become_pairs(protocol: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """MPEG-TS of two cameras; RTSP of one that shows both sides, to which our side listens, since
    FFmpeg has no server.
    """
    monkeypatch.setenv(
        "OPENCV_FFMPEG_CAPTURE_OPTIONS",
        f"{live_cameras.FFMPEG_OPTIONS}|rtsp_flags;listen|listen_timeout;20",
    )
    addresses = [f"{protocol}://127.0.0.1:{free_port()}/{side}" for side in ("left", "right")]
    shows: list[tuple[int, ...]] = [(60,), (180,)]
    if protocol == "rtsp":
        addresses, shows = addresses[:1], [(60, 180)]
    with ExitStack() as stack:
        sides = stack.enter_context(cameras(addresses[0], addresses[-1]))
        for address, values in zip(addresses, shows, strict=True):
            stack.enter_context(sent(address, values, {"udp": "mpegts"}.get(protocol, protocol)))
        source = StreamPairs(*sides, InputConfig())
        for _ in range(3):
            pair = until(source.newest)
            frame = source.read(pair)
            assert frame.left.shape == (48, 64, 3)
            assert [round(side.mean(), -1) for side in (frame.left, frame.right)] == [60, 180]
            source.take(pair)


@pytest.mark.slow
def test_a_server_that_is_restarted_is_found_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_cameras, "TIMEOUT_MS", 500)
    monkeypatch.setattr(live_cameras, "RETRY_S", 0.1)
    both = np.hstack([np.full((48, 64, 3), value, np.uint8) for value in (60, 180)])
    with motion_jpeg({"both": [jpeg(both)]}) as port:
        address = f"http://127.0.0.1:{port}/both"
        around = cameras(address, address)
        sides = around.__enter__()
        source = StreamPairs(*sides, InputConfig())
        pair = until(source.newest)
        frame = source.read(pair)
        assert [round(side.mean(), -1) for side in (frame.left, frame.right)] == [60, 180]
    until(lambda: source.waiting == address)
    with motion_jpeg({"both": [jpeg(both)]}, port=port):
        until(lambda: source.waiting == "" and source.newest())
    around.__exit__(None, None, None)


def test_sides_of_two_kinds_are_refused(tmp_path: Path) -> None:
    with (
        ExitStack() as stack,
        pytest.raises(InputError, match="two folders, two cameras, or two topics"),
    ):
        live_source("0", str(tmp_path), InputConfig(), stack)
    if not cv2.videoio_registry.hasBackend(cv2.CAP_GSTREAMER):
        with (
            pytest.raises(DeviceError, match="built without GStreamer"),
            cameras("v4l2src ! appsink", "0"),
        ):
            pass


def send(stream: ImageStream, milliseconds: float) -> None:
    """An image that is its stamp."""
    value = np.full((1, 1, 3), milliseconds % 256, np.uint8)
    stream.add(Arrived(10**18 + round(milliseconds * 1e6), time.monotonic(), lambda: value))


def test_images_of_one_time_become_pairs_and_the_newest_wins() -> None:
    left, right = ImageStream("left"), ImageStream("right")
    source = StreamPairs(left, right, InputConfig())
    send(left, 0)
    assert source.newest() is None
    send(right, 3)
    first = source.newest()
    assert first is not None
    assert (first.name, source.read(first).right[0, 0, 0]) == ("1000000000-000000000", 3)
    source.take(first)
    assert source.newest() is None
    for ms in (100, 200, 300):
        send(left, ms)
        send(right, ms + 4)
    send(left, 400)  # its partner has not come
    pair = source.newest()
    assert pair is not None
    assert pair.name == "1000000000-300000000"
    source.take(pair)
    assert (source.dropped, source.newest()) == (2, None)
    send(right, 404)
    assert source.newest() is not None
    send(right, 460)
    send(left, 500)  # 40 ms off: beyond the tolerance, but less than half the time between images
    found = source.newest()
    assert found is not None
    assert found.name == "1000000000-500000000"
    with pytest.raises(InputError, match="a newer pair has come"):
        source.read(first)


def test_pairs_come_on_when_the_clock_is_set_back() -> None:
    """By a GPS fix, or where a recording is played in a loop."""
    left, right = ImageStream("left"), ImageStream("right")
    source, names = StreamPairs(left, right, InputConfig()), []
    for ms in (5000, 5100, 0, 100, 200):
        send(left, ms)
        send(right, ms + 3)
        found = source.newest()
        assert found is not None, ms
        names.append(found.name[-9:])
        source.take(found)
    assert names == ["000000000", "100000000", "000000000", "100000000", "200000000"]
    assert source.dropped == 0


def test_a_stream_that_is_open_and_sends_nothing_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    left, right = ImageStream("left"), ImageStream("right")
    source = StreamPairs(left, right, InputConfig())
    assert source.waiting == "left and right"
    send(left, 0)
    right.waiting = ""  # as where a topic has a publisher
    assert (source.waiting, source.has_unpaired) == ("right", True)
    send(right, 0)
    assert source.waiting == ""
    monkeypatch.setattr(live_streams, "QUIET_S", -1.0)
    assert (source.waiting, source.has_unpaired) == ("left and right", False)


def test_two_free_running_cameras_half_an_image_apart_are_no_pair() -> None:
    left, right = ImageStream("left"), ImageStream("right")
    for ms in (0, 100, 200, 300):
        send(left, ms)
        send(right, ms + 50)
    assert StreamPairs(left, right, InputConfig()).newest() is None


PUBLISHER = """
import sys, time
import cv2, numpy as np
sys.path.insert(0, sys.argv[1])
from stereo_seecolor.extras.streams import ros_messages as ros
from stereo_seecolor.extras.streams.live.ros2 import Node
node = Node()
images = {side: cv2.imread(f"{sys.argv[2]}/{folder}/0000.png") for side, folder in (("left", "L"), ("right", "R"))}
for number in range(3000):
    stamp_ns = 1_700_000_000_000_000_000 + number * 100_000_000
    for side, image in images.items():
        height, width = image.shape[:2]
        message = ros.make("Image", ros.header(stamp_ns, "camera"), height, width, "bgr8", 0, 3 * width, image.reshape(-1))
        node.publish(f"/stereo/{side}/image_raw", ros.type_name("Image"), ros.serialize("Image", message))
        packed = cv2.imencode(".png", image)[1]
        message = ros.compressed_image(stamp_ns, packed.tobytes(), ".png")
        topic = f"/stereo/{side}/image_raw/compressed"
        node.publish(topic, ros.type_name("CompressedImage"), ros.serialize("CompressedImage", message))
    time.sleep(0.1)
"""  # noqa: E501


@pytest.fixture
def published(make_dive, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A dive whose first pair another process publishes, raw and compressed, on this machine
    alone.
    """
    if (sys.platform, platform.machine()) != ("linux", "x86_64") or sys.version_info >= (3, 14):
        pytest.skip("Cyclone DDS has no wheel for this machine")
    loopback = (
        "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name='lo' "
        "multicast='true'/></Interfaces>"
    )
    loopback += "<AllowMulticast>spdp</AllowMulticast></General></Domain></CycloneDDS>"
    monkeypatch.setenv("CYCLONEDDS_URI", loopback)
    monkeypatch.setenv("ROS_DOMAIN_ID", "87")
    dive = make_dive(1)
    words = [sys.executable, "-c", PUBLISHER, str(Path(__file__).parents[3]), str(dive.root)]
    with subprocess.Popen(words, stderr=subprocess.PIPE, text=True) as process:
        try:
            yield dive.root
        finally:
            process.kill()


@pytest.mark.slow
@pytest.mark.parametrize("suffix", ["", "/compressed"])
def test_topics_of_another_process_are_read(published: Path, suffix: str) -> None:
    with ExitStack() as stack:
        sides = (f"ros2:/stereo/{side}/image_raw{suffix}" for side in ("left", "right"))
        source = live_source(*sides, InputConfig(), stack)
        pair = until(source.newest)
        frame = source.read(pair)
        assert source.waiting == ""
        assert re.fullmatch(r"17000\d{5}-\d{9}", pair.name)
        for side, image in (("L", frame.left), ("R", frame.right)):
            np.testing.assert_array_equal(
                image, cv2.imread(str(published / side / "0000.png"))[..., ::-1]
            )
        source.take(pair)
        assert until(source.newest).name > pair.name


@pytest.mark.slow
def test_corrected_pairs_are_published_and_every_message_is_decoded(
    published: Path, cli, tmp_path: Path
) -> None:
    from rosbags.typesys import Stores, get_typestore

    from stereo_seecolor.extras.streams.live.ros2 import Node
    from stereo_seecolor.extras.streams.mcap_recording import TOPICS
    from stereo_seecolor.extras.streams.ros_messages import type_name

    store, node, found = get_typestore(Stores.ROS2_HUMBLE), Node(), {}
    readers = {
        topic: node.reader(topic.replace("/stereo", "/seecolor"), type_name(name))
        for topic, name in TOPICS.items()
        if topic != "/tf"
    }
    sides = ("--left", "ros2:/stereo/left/image_raw", "--right", "ros2:/stereo/right/image_raw")
    words = [
        sys.executable,
        "-m",
        "stereo_seecolor",
        "live",
        *sides,
        "--calib",
        published / "cam.yaml",
        "--publish",
        "seecolor",
    ]
    with subprocess.Popen(
        [str(word) for word in words], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    ) as process:

        def all_came() -> bool:
            for topic, reader in readers.items():
                for sample in reader.take(N=8):
                    found[topic] = store.deserialize_cdr(
                        bytes(sample.cdr), type_name(TOPICS[topic])
                    )
            return len(found) == len(readers)

        until(all_came, 120)
        process.terminate()
    size = cv2.imread(str(published / "L" / "0000.png")).shape[:2]
    image = cv2.imdecode(found["/stereo/left/image_rect_color/compressed"].data, cv2.IMREAD_COLOR)
    range_m = found["/stereo/range/image_rect"].data.view("<f4").reshape(size)
    assert image.shape[:2] == size
    assert np.isfinite(range_m).mean() > 0.5
    assert found["/stereo/points2"].width > 500
    assert found["/stereo/disparity"].t > 0
    assert found["/stereo/right/camera_info"].p[3] < 0
