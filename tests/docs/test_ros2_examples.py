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
        data=image.tobytes(),
    )


@pytest.mark.slow
def test_the_node_publishes_corrected_pairs_at_one_exposure(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    topics_out: dict[str, list[SimpleNamespace]] = {}
    topics: list[str] = []
    called: list[Any] = []
    node = SimpleNamespace(
        create_publisher=lambda _, topic, queue: SimpleNamespace(
            publish=topics_out.setdefault(topic, []).append
        ),
        get_clock=lambda: SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=8 * 10**9)),
        get_logger=lambda: SimpleNamespace(warning=lambda text: pytest.fail(text)),
    )

    def spin(_: Any) -> None:
        for left in sorted((DIVE / "left").iterdir())[:2]:
            called[0](message(left), message(DIVE / "right" / left.name))

    module(monkeypatch, "rclpy", init=lambda: None, create_node=lambda _: node, spin=spin)
    module(monkeypatch, "sensor_msgs")
    module(monkeypatch, "sensor_msgs.msg", Image=SimpleNamespace)
    module(monkeypatch, "std_msgs")
    module(monkeypatch, "std_msgs.msg", Float32=SimpleNamespace)
    module(
        monkeypatch,
        "message_filters",
        Subscriber=lambda _, kind, topic: topics.append(topic),
        ApproximateTimeSynchronizer=lambda *_: SimpleNamespace(registerCallback=called.append),
    )
    runpy.run_path(str(EXAMPLES / "seecolor_node.py"))["main"](str(DIVE / "cam.yaml"))
    assert topics == ["/stereo/left", "/stereo/right"]
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
