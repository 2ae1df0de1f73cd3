"""A node of ROS 2 that corrects a stereo pair in its own process: python seecolor_node.py cam.yaml.

For a vehicle without code of its own, ``stereo-seecolor live --left ros2:/TOPIC`` does the same.
"""

import sys

import message_filters
import numpy as np
import rclpy
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Image, PointCloud2, PointField
from std_msgs.msg import Float32

from stereo_seecolor import Pipeline, SeeColorError, StereoFrame, Stream

CHANNELS = {"rgb8": (0, 1, 2), "bgr8": (2, 1, 0), "rgba8": (0, 1, 2), "bgra8": (2, 1, 0)}
"""Which channels of an encoding are red, green and blue."""
FLOAT32 = 7  # sensor_msgs/PointField


def pixels_of(message: Image) -> np.ndarray:
    """(H, W, 3) RGB of an image message; its rows may be padded (step). Raises SeeColorError."""
    if message.encoding not in CHANNELS:
        raise SeeColorError(
            f"encoding {message.encoding!r} is not read here: send one of {', '.join(CHANNELS)}"
        )
    rows = np.frombuffer(message.data, np.uint8).reshape(message.height, message.step)
    channels = 4 if "a" in message.encoding else 3
    image = rows[:, : channels * message.width].reshape(message.height, message.width, channels)
    return np.ascontiguousarray(image[..., list(CHANNELS[message.encoding])])


def image_message(header: object, pixels: np.ndarray, encoding: str) -> Image:
    """An image message of pixels (H, W, ...) in an encoding of little-endian numbers."""
    height, width = pixels.shape[:2]
    step = pixels[0].nbytes
    size = {"height": height, "width": width, "step": step, "is_bigendian": 0}
    return Image(header=header, encoding=encoding, data=pixels.tobytes(), **size)


def points_message(header: object, xyz_m: np.ndarray, color: np.ndarray) -> PointCloud2:
    """A cloud of points (N, 3), meters in the rectified left camera's axes, with colors (N, 3)."""
    known = np.isfinite(xyz_m).all(axis=-1)
    places = xyz_m[known].astype("<f4").view(np.uint8)
    padding = np.zeros(len(places), np.uint8)
    rows = np.column_stack([places, color[known][:, ::-1], padding])  # as PCL and RViz read rgb
    names = ("x", "y", "z", "rgb")
    fields = [
        PointField(name=name, offset=4 * i, datatype=FLOAT32, count=1)
        for i, name in enumerate(names)
    ]
    size = {"height": 1, "width": len(rows), "point_step": 16, "row_step": 16 * len(rows)}
    content = {"fields": fields, "is_bigendian": False, "is_dense": True, "data": rows.tobytes()}
    return PointCloud2(header=header, **size, **content)


def main(calib: str) -> None:
    """Subscribe to /stereo/left and /stereo/right; publish /seecolor/image (rgb8), /seecolor/range
    (32FC1, meters along the ray, NaN unknown), /seecolor/points, and /seecolor/latency_s: seconds
    from the stamp of the left image to its corrected one.
    """
    rclpy.init()
    node, pipeline = rclpy.create_node("seecolor"), Pipeline(calib)
    stream = Stream(pipeline)
    kinds = {"image": Image, "range": Image, "points": PointCloud2, "latency_s": Float32}
    publishers = {
        name: node.create_publisher(kind, f"/seecolor/{name}", qos_profile_sensor_data)
        for name, kind in kinds.items()
    }

    def corrected(left: Image, right: Image) -> None:
        try:
            result = stream.process(StereoFrame("live", pixels_of(left), pixels_of(right)))
        except SeeColorError as error:  # this pair alone
            node.get_logger().warning(str(error))
            return
        image, range_m = result.correction.image, result.range_map.measured_m
        stamp, now_ns = left.header.stamp, node.get_clock().now().nanoseconds
        publishers["image"].publish(image_message(left.header, image, "rgb8"))
        publishers["range"].publish(image_message(left.header, range_m.astype("<f4"), "32FC1"))
        xyz_m = pipeline.geometry.points_from_range(range_m).reshape(-1, 3)
        publishers["points"].publish(points_message(left.header, xyz_m, image.reshape(-1, 3)))
        age_s = (now_ns - stamp.sec * 10**9 - stamp.nanosec) / 1e9
        publishers["latency_s"].publish(Float32(data=age_s))

    sides = [
        message_filters.Subscriber(
            node, Image, f"/stereo/{side}", qos_profile=qos_profile_sensor_data
        )
        for side in ("left", "right")
    ]
    message_filters.ApproximateTimeSynchronizer(sides, 5, 0.02).registerCallback(corrected)
    rclpy.spin(node)


if __name__ == "__main__":
    main(sys.argv[1])
