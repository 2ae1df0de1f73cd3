"""Bags and the ROS 1 tools of Debian (python3-rosbag, python3-sensor-msgs): they read what is read
here, and write what is.
"""

import json
import subprocess
from pathlib import Path

import cv2
import numpy as np
import pytest
from bag_writers import START_NS, camera_infos, dive_messages, name_by_stamps, stamp_of, write_bag

from stereo_seecolor.config import InputConfig
from stereo_seecolor.extras.streams.bags.dive import open_dive
from stereo_seecolor.inputs.images import read_image

PYTHON = "/usr/bin/python3"
"""Debian's own, which its packages belong to."""

READ = """
import hashlib, json, rosbag, sys
found = []
with rosbag.Bag(sys.argv[1]) as bag:
    for topic, message, time in bag.read_messages():
        data = hashlib.sha256(message.data).hexdigest() if hasattr(message, "data") else list(message.K)
        found.append([topic, message._type, message.header.stamp.to_nsec(), data])
print(json.dumps(found))
"""  # noqa: E501

WRITE = """
import glob, os, rosbag, rospy, sys
from sensor_msgs.msg import CompressedImage, Image
folder, out, compression = sys.argv[1:]
with rosbag.Bag(out, "w", compression=compression) as bag:
    for path in sorted(glob.glob(f"{folder}/[LR]/*.png"), key=os.path.basename):
        side = "left" if "/L/" in path else "right"
        seconds, nanoseconds = os.path.basename(path)[:-4].split("-")
        stamp = rospy.Time(int(seconds), int(nanoseconds))
        message = CompressedImage(format="png", data=open(path, "rb").read())
        message.header.stamp = stamp
        bag.write(f"/stereo/{side}/image_raw/compressed", message, stamp)
"""


def ros1(script: str, *words: object) -> str:
    done = subprocess.run(
        [PYTHON, "-W", "ignore", "-c", script, *map(str, words)],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module", autouse=True)
def _tools() -> None:
    try:
        subprocess.run(
            [PYTHON, "-c", "import rosbag, sensor_msgs.msg"],
            check=True,
            capture_output=True,
            timeout=60,
        )
    except (OSError, subprocess.CalledProcessError):
        pytest.skip(
            "Debian's ROS 1 tools are not installed (apt-get install python3-rosbag "
            "python3-sensor-msgs)"
        )


@pytest.fixture
def dive(make_dive):
    made = make_dive(2)
    name_by_stamps(made.root)
    return made


@pytest.mark.slow
def test_the_tools_of_ros_1_read_the_bag_of_a_dive(dive, tmp_path: Path) -> None:
    bag = write_bag(
        tmp_path / "b.bag", [*camera_infos(dive.root / "cam.yaml"), *dive_messages(dive.root)]
    )
    found = json.loads(ros1(READ, bag))
    topics = [topic for topic, *_ in found]
    assert sorted(set(topics)) == [
        f"/stereo/{side}/{kind}"
        for side in ("left", "right")
        for kind in ("camera_info", "image_raw")
    ]
    infos = [(kind, stamp_ns) for topic, kind, stamp_ns, _ in found if topic.endswith("info")]
    assert infos == [("sensor_msgs/CameraInfo", START_NS)] * 2
    stamps = [stamp_ns for topic, _, stamp_ns, _ in found if topic == "/stereo/left/image_raw"]
    assert stamps == [stamp_of(path) for path in sorted((dive.root / "L").iterdir())]
    rig = open_dive(bag, "", InputConfig()).rig()
    (K,) = [K for topic, *_, K in found if topic == "/stereo/left/camera_info"]
    np.testing.assert_allclose(np.reshape(K, (3, 3)), rig.left.K)


@pytest.mark.slow
@pytest.mark.parametrize("compression", ["none", "bz2", "lz4"])
def test_a_bag_of_the_tools_of_ros_1_is_read(dive, tmp_path: Path, compression: str) -> None:
    bag = tmp_path / "written.bag"
    ros1(WRITE, dive.root, bag, compression)
    found = open_dive(bag, "", InputConfig())
    assert [pair.name for pair in found.pairing.pairs] == sorted(
        path.stem for path in (dive.root / "L").iterdir()
    )
    assert not found.bag.problems
    for pair in found.pairing.pairs:
        for side, path in (("L", pair.left), ("R", pair.right)):
            expected = cv2.imread(str(dive.root / side / f"{pair.name}.png"))[..., ::-1]
            np.testing.assert_array_equal(read_image(path), expected)
