"""The sources of live: folders, cameras, topics, or a bag."""

from contextlib import ExitStack
from pathlib import Path

from stereo_seecolor.config import InputConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.streams.bags.bag import is_bag
from stereo_seecolor.extras.streams.live.cameras import cameras, is_address
from stereo_seecolor.extras.streams.live.folder_watch import FolderWatch
from stereo_seecolor.extras.streams.live.ros2 import PREFIX, Node, TopicImages
from stereo_seecolor.extras.streams.live.session import LiveSource
from stereo_seecolor.extras.streams.live.streams import StreamPairs

SIDES = ("left", "right")
"""Folders of the sides in a folder that holds both."""


def source_of(source: str) -> tuple[str, str, Path | None]:
    """Left side, right side and bag of --source: ``dive.mcap``; ``INCOMING``, with left/ and right/
    in it; ``LEFT,RIGHT``; or a camera that shows both sides.
    """
    path = Path(source)
    if is_bag(path):
        return "", "", path
    if path.is_dir():
        return str(path / SIDES[0]), str(path / SIDES[1]), None
    left, comma, right = source.partition(",")
    return left, right if comma else left, None


def live_source(left: str, right: str, config: InputConfig, stack: ExitStack) -> LiveSource:
    """The source of two sides, open until ``stack`` closes. Raises InputError, DeviceError."""
    kinds = [
        PREFIX if side.startswith(PREFIX) else "address" if is_address(side) else "folder"
        for side in (left, right)
    ]
    if kinds[0] != kinds[1]:
        raise InputError(
            f"{left} and {right}: are sources of different kinds: give two folders, two cameras, "
            "or two topics"
        )
    if kinds[0] == PREFIX:
        node = Node()
        first, second = (
            TopicImages(node, side.removeprefix(PREFIX), config) for side in (left, right)
        )
        return StreamPairs(first, second, config)
    if kinds[0] == "address":
        return StreamPairs(*stack.enter_context(cameras(left, right)), config)
    if left == right:
        raise InputError(
            f"{left}: is --left and --right: only run reads images that show both sides from a "
            "folder"
        )
    return FolderWatch(Path(left), Path(right), config)
