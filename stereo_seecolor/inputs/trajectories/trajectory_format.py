"""What a format of trajectories is: it recognizes its files and reads their poses.

Packages add formats by entry points of the group ``stereo_seecolor.trajectory_formats``; this
package's own of few users (``extras/trajectory_formats``) are added in the same way. See
docs/extending.md.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from stereo_seecolor.config import MountConfig
from stereo_seecolor.inputs.trajectories.table import Lines
from stereo_seecolor.plugins import added, load
from stereo_seecolor.records import Trajectory


@dataclass(frozen=True)
class TextFormat:
    """A format of text files.

    title: of the format, in messages.
    recognizes: tells by the lines of a file whether it is of this format.
    read: the poses; how the camera sits on the vehicle, for formats of the vehicle's own pose.
    Raises InputError.
    is_json: its files are JSON; a format of other text is not asked about JSON.
    """

    title: str
    recognizes: Callable[[Lines], bool]
    read: Callable[[Lines, MountConfig], Trajectory]
    is_json: bool = False


@dataclass(frozen=True)
class FileFormat:
    """A format of folders, or of files that are not text.

    title: of the format, in messages. recognizes: tells whether a path is of this format.
    read: as of a TextFormat.
    """

    title: str
    recognizes: Callable[[Path], bool]
    read: Callable[[Path, MountConfig], Trajectory]


def added_formats() -> list[TextFormat | FileFormat]:
    """The formats that packages add. Raises PluginError for a package that adds something else."""
    group = "trajectory_formats"
    return [load(group, name, (TextFormat, FileFormat)) for name in added(group)]
