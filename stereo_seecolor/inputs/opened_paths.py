"""Paths into a video, a bag, or an image of both sides, opened by the path alone."""

from pathlib import Path

from stereo_seecolor.files.contained import Container, find_contained, open_containers
from stereo_seecolor.inputs.halves import Halves, is_half
from stereo_seecolor.inputs.video_frames import VideoImages, is_video
from stereo_seecolor.plugins import added, load


def open_around(path: Path) -> None:
    """Open the video, bag or image that ``path`` leads into. Raises InputError, DeviceError."""
    if find_contained(path):
        return
    if is_half(path):
        image = path.parent.parent
        open_containers({image: Halves(image)})
        return
    outer = next(
        (
            parent
            for parent in path.parents
            if is_video(parent) or _kind(parent) in added("containers")
        ),
        None,
    )
    if outer and outer.is_file():
        open_containers({outer: container_of(outer)})


def container_of(outer: Path) -> Container:
    """The images inside a video, or inside a file that a package reads. Raises PluginError."""
    if is_video(outer):
        return VideoImages(outer)
    container: Container = load("containers", _kind(outer), needs=("__call__",))(outer)
    return container


def _kind(path: Path) -> str:
    return path.suffix.lower().removeprefix(".")
