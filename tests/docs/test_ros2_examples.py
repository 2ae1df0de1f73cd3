"""The examples for ROS 2, with stand-ins for its packages: what they subscribe to, start, and
publish.
"""

import runpy
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from stereo_seecolor.errors import SeeColorError
from stereo_seecolor.inputs.images import read_image

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES, DIVE = ROOT / "examples" / "ros2", ROOT / "data_samples" / "reef"


def module(monkeypatch: pytest.MonkeyPatch, name: str, **content: Any) -> None:
    made = ModuleType(name)
    vars(made).update(content)
    monkeypatch.setitem(sys.modules, name, made)


def message(path: Path) -> SimpleNamespace:
    image = read_image(path)
    return SimpleNamespace(
        header=SimpleNamespace(name=path.stem, stamp=SimpleNamespace(sec=7, nanosec=500_000_000)),
        height=image.shape[0],
        width=image.shape[1],
        encoding="rgb8",
        step=3 * image.shape[1],
        data=image.tobytes(),
    )


def as_driver(sent: SimpleNamespace, encoding: str) -> SimpleNamespace:
    """The message as a driver sends it that pads its rows to whole words."""
    pixels = np.frombuffer(sent.data, np.uint8).reshape(sent.height, sent.width, 3)
    if encoding.startswith("bgr"):
        pixels = pixels[..., ::-1]
    if encoding.endswith("a8"):
        pixels = np.dstack([pixels, np.full(pixels.shape[:2], 255, np.uint8)])
    rows = pixels.reshape(sent.height, -1)
    rows = np.pad(rows, ((0, 0), (0, 12)), constant_values=77)
    return SimpleNamespace(
        **vars(sent) | {"encoding": encoding, "step": rows.shape[1], "data": rows.tobytes()}
    )


def stand_ins(monkeypatch: pytest.MonkeyPatch, node: SimpleNamespace, **more: Any) -> None:
    """Modules in the place of ROS 2's."""
    module(monkeypatch, "rclpy", init=lambda: None, create_node=lambda _: node, **more)
    module(monkeypatch, "rclpy.qos", qos_profile_sensor_data="sensor data")
    module(monkeypatch, "sensor_msgs")
    kinds = dict.fromkeys(("Image", "PointCloud2", "PointField"), SimpleNamespace)
    module(monkeypatch, "sensor_msgs.msg", **kinds)
    module(monkeypatch, "std_msgs")
    module(monkeypatch, "std_msgs.msg", Float32=SimpleNamespace)
    module(monkeypatch, "message_filters")


def test_pixels_are_read_in_their_encoding_without_the_padding_of_rows(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    stand_ins(monkeypatch, SimpleNamespace())
    example = runpy.run_path(str(EXAMPLES / "seecolor_node.py"))
    image = np.random.default_rng(2).integers(0, 256, (5, 7, 3)).astype(np.uint8)
    sent = SimpleNamespace(height=5, width=7, data=image.tobytes())
    for encoding in ("rgb8", "bgr8", "rgba8", "bgra8"):
        found = example["pixels_of"](as_driver(sent, encoding))
        np.testing.assert_array_equal(found, image)
    with pytest.raises(SeeColorError, match="'mono8' is not read here: send one of rgb8, bgr8"):
        example["pixels_of"](SimpleNamespace(encoding="mono8"))


@pytest.mark.slow
def test_the_node_publishes_corrected_pairs_at_one_exposure(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    topics_out: dict[str, list[SimpleNamespace]] = {}
    topics: list[str] = []
    called: list[Any] = []
    qualities: list[str] = []
    node = SimpleNamespace(
        create_publisher=lambda _, topic, qos: (
            qualities.append(qos)
            or SimpleNamespace(publish=topics_out.setdefault(topic, []).append)
        ),
        get_clock=lambda: SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=8 * 10**9)),
        get_logger=lambda: SimpleNamespace(warning=lambda text: pytest.fail(text)),
    )

    def spin(_: Any) -> None:
        for left in sorted((DIVE / "left").iterdir())[:2]:
            right = message(DIVE / "right" / left.name)
            called[0](as_driver(message(left), "bgr8"), as_driver(right, "rgba8"))

    def subscribe(_: Any, kind: Any, topic: str, qos_profile: str) -> None:
        topics.append(topic)
        qualities.append(qos_profile)

    stand_ins(monkeypatch, node, spin=spin)
    module(
        monkeypatch,
        "message_filters",
        Subscriber=subscribe,
        ApproximateTimeSynchronizer=lambda *_: SimpleNamespace(registerCallback=called.append),
    )
    runpy.run_path(str(EXAMPLES / "seecolor_node.py"))["main"](str(DIVE / "cam.yaml"))
    assert topics == ["/stereo/left", "/stereo/right"]
    assert set(qualities) == {"sensor data"}
    published = topics_out["/seecolor/image"]
    assert [each.data for each in topics_out["/seecolor/latency_s"]] == [0.5, 0.5]
    assert [each.header.name for each in published] == [
        path.stem for path in sorted((DIVE / "left").iterdir())[:2]
    ]
    medians = []
    for each in published:
        image = np.frombuffer(each.data, np.uint8).reshape(each.height, each.width, 3)
        medians.append(np.median(image))
    assert medians[0] == pytest.approx(medians[1], rel=0.2)
    for image, sent, cloud in zip(
        published, topics_out["/seecolor/range"], topics_out["/seecolor/points"], strict=True
    ):
        assert (sent.encoding, sent.step) == ("32FC1", 4 * sent.width)
        range_m = np.frombuffer(sent.data, "<f4").reshape(sent.height, sent.width)
        known = np.isfinite(range_m)
        assert known.mean() > 0.5
        assert [(each.name, each.offset) for each in cloud.fields][2:] == [("z", 8), ("rgb", 12)]
        kinds = [("xyz", "<f4", 3), ("bgr", "u1", 3), ("padding", "u1")]
        points = np.frombuffer(cloud.data, kinds)
        assert cloud.width == len(points) == known.sum()
        far_m = np.linalg.norm(points["xyz"], axis=1)
        np.testing.assert_allclose(far_m, range_m[known], rtol=1e-4)
        colors = np.frombuffer(image.data, np.uint8).reshape(*known.shape, 3)[known]
        np.testing.assert_array_equal(points["bgr"][:, ::-1], colors)


def test_the_launch_file_starts_live_with_its_parameters(monkeypatch: pytest.MonkeyPatch) -> None:
    module(monkeypatch, "launch", LaunchDescription=list)
    module(
        monkeypatch,
        "launch.actions",
        DeclareLaunchArgument=lambda name, default_value: (name, default_value),
        ExecuteProcess=lambda cmd, output: cmd,
    )
    module(monkeypatch, "launch.substitutions", LaunchConfiguration=lambda name: f"<{name}>")
    made = runpy.run_path(str(EXAMPLES / "seecolor.launch.py"))
    *arguments, command = made["generate_launch_description"]()
    assert dict(arguments) == made["PARAMETERS"]
    flat = ["".join(part) if isinstance(part, list) else part for part in command]
    assert flat[:4] == ["stereo-seecolor", "live", "--left", "ros2:<left>"]
    assert "color.lock=<frames_of_a_water>" in flat
