"""A node of ROS 2 that corrects a stereo pair in its own process: python seecolor_node.py cam.yaml.

For a vehicle without code of its own, ``stereo-seecolor live --left ros2:/TOPIC`` does the same.
"""

import sys

import message_filters
import numpy as np
import rclpy
from sensor_msgs.msg import Image
from std_msgs.msg import Float32

from stereo_seecolor import Pipeline, SeeColorError, StereoFrame, Stream


def main(calib: str) -> None:
    """Subscribe to /stereo/left and /stereo/right (rgb8), publish /seecolor/image, and
    /seecolor/latency_s: seconds from the stamp of the left image to its corrected one.
    """
    rclpy.init()
    node, stream = rclpy.create_node("seecolor"), Stream(Pipeline(calib))
    publisher = node.create_publisher(Image, "/seecolor/image", 1)
    latency = node.create_publisher(Float32, "/seecolor/latency_s", 1)

    def corrected(left: Image, right: Image) -> None:
        pixels = [np.frombuffer(m.data, np.uint8).reshape(m.height, -1, 3) for m in (left, right)]
        try:
            image = stream.process(StereoFrame("live", *pixels)).correction.image
        except SeeColorError as error:  # this pair alone
            node.get_logger().warning(str(error))
            return
        size = {"height": image.shape[0], "width": image.shape[1], "step": 3 * image.shape[1]}
        publisher.publish(Image(header=left.header, encoding="rgb8", data=image.tobytes(), **size))
        stamp, now_ns = left.header.stamp, node.get_clock().now().nanoseconds
        latency.publish(Float32(data=(now_ns - stamp.sec * 10**9 - stamp.nanosec) / 1e9))

    sides = [
        message_filters.Subscriber(node, Image, f"/stereo/{side}") for side in ("left", "right")
    ]
    message_filters.ApproximateTimeSynchronizer(sides, 5, 0.02).registerCallback(corrected)
    rclpy.spin(node)


if __name__ == "__main__":
    main(sys.argv[1])
