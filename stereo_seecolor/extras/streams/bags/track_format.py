"""A ROS bag as a format of trajectories."""

from pathlib import Path

from stereo_seecolor.config import MountConfig
from stereo_seecolor.extras.streams.bags.bag import is_bag
from stereo_seecolor.inputs.trajectories.trajectory_format import FileFormat
from stereo_seecolor.records import Trajectory


def read(path: Path, mount: MountConfig) -> Trajectory:
    """The track that a bag holds: see ``read_track``."""
    from stereo_seecolor.extras.streams.bags.track import read_track

    return read_track(path, mount)


FORMAT = FileFormat("ROS bag", is_bag, read)
