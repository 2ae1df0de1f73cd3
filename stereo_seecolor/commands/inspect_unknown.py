"""Files that were named to ``inspect`` and that it cannot use."""

from collections.abc import Collection, Sequence
from pathlib import Path

from calibration import CalibrationError
from calibration.formats import load_rig
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.listing import BAG, EXTENSIONS, unread_hint
from stereo_seecolor.inputs.trajectories import read_trajectory
from stereo_seecolor.inputs.video_frames import is_video

NOT_KNOWN = (
    "is not a trajectory of a known format",
    "is not a calibration",
    "cannot be parsed",
    "is not text",
)
"""Of errors that say no more than that a file is something else."""


def unknown_files(
    places: Sequence[Path], known: Collection[Path], problems: Sequence[str]
) -> tuple[str, ...]:
    """A line for each file of the places that is not among the known ones, with what it is where
    that can be told.

    problems: lines that name files already.
    """
    files = [
        place
        for place in places
        if place.exists() and not place.is_dir() and place not in known
        if not (place.is_file() and _is_images(place))
    ]
    return tuple(_line(file) for file in files if not any(str(file) in line for line in problems))


def _is_images(path: Path) -> bool:
    return path.suffix.lower() in EXTENSIONS or is_video(path)


def _line(file: Path) -> str:
    if BAG.search(file.name):
        return f"not used{unread_hint([str(file)])}"
    for read in (read_trajectory, load_rig):
        try:
            read(file)
        except (InputError, CalibrationError) as error:
            if not any(words in str(error) for words in NOT_KNOWN):
                return f"not used: {error}"
    return f"not used: {file}: is neither images, nor a calibration or trajectory of a known format"
