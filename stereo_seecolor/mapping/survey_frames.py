"""The frames of a survey, some of which may be lost: these are named, and left out."""

from collections.abc import Sequence
from dataclasses import dataclass

from stereo_seecolor.compute.sequences import Lazy
from stereo_seecolor.errors import FrameError
from stereo_seecolor.records import SurveyFrame


@dataclass(frozen=True)
class Unplaced:
    """A frame that is not in the map, and why."""

    name: str
    reason: str


Frames = Sequence[SurveyFrame | Unplaced]


def scaled(frame: SurveyFrame | Unplaced, scale: float) -> SurveyFrame | Unplaced:
    """Scale a frame's ranges: its rig's scale is known better than by calibration."""
    return frame if isinstance(frame, Unplaced) else frame.scaled(scale)


class ReadableFrames(Lazy[SurveyFrame | Unplaced]):
    """Frames as they are read; one whose files are missing or damaged is Unplaced from then on.
    lost: those, by number.
    """

    def __init__(self, frames: Sequence[SurveyFrame]) -> None:
        self._frames = frames
        self.lost: dict[int, Unplaced] = {}

    def __len__(self) -> int:
        return len(self._frames)

    def item(self, number: int) -> SurveyFrame | Unplaced:
        """Read a frame; Unplaced if it is lost."""
        if number not in self.lost:
            try:
                return self._frames[number]
            except FrameError as error:
                self.lost[number] = Unplaced(error.name, str(error))
        return self.lost[number]
