"""oplab's ``stereo_<left>_<right>.yaml``: ROS's keys, with OpenCV's extrinsics."""

from calibration.formats.calibration_format import RigFormat
from calibration.formats.reading.section import Section, naming
from calibration.formats.ros import parse_camera
from calibration.rig import StereoRig
from calibration.transforms import rigid_transform


def matches(document: Section) -> bool:
    """True for a stereo file of oplab."""
    left = document.content.get("left")
    return (
        document.has("left", "right", "extrinsics")
        and isinstance(left, dict)
        and {"camera_matrix", "image_width"} <= set(left)
    )


def parse(document: Section, image_size: tuple[int, int] | None) -> StereoRig:
    """The rig. Rectification, essential and fundamental matrices are not read: the last are rounded
    to nothing in the file.
    """
    left, right = (parse_camera(document.section(side)) for side in ("left", "right"))
    extrinsics = document.section("extrinsics")
    R, t = extrinsics.matrix("rotation_matrix", 3, 3), extrinsics.numbers("translation_vector", 3)
    with naming(extrinsics.where):
        return StereoRig(left, right, rigid_transform(R, t))


FORMAT = RigFormat(matches, parse)
