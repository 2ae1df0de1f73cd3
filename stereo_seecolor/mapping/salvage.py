"""A survey's frames, of which some may turn out to be gone: each is named, and the map is made of the rest."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import overload

from stereo_seecolor.data import SurveyFrame
from stereo_seecolor.errors import FrameError


@dataclass(frozen=True)
class Unplaced:
    """A frame that is not in the map, and why."""

    name: str
    reason: str


Frames = Sequence[SurveyFrame | Unplaced]


class Salvage(Frames):
    """Frames as they are read; one whose files are gone or damaged is Unplaced from then on. lost: those, by number."""

    def __init__(self, frames: Sequence[SurveyFrame]) -> None:
        self._frames = frames
        self.lost: dict[int, Unplaced] = {}

    def __len__(self) -> int:
        return len(self._frames)

    @overload
    def __getitem__(self, index: int) -> SurveyFrame | Unplaced: ...
    @overload
    def __getitem__(self, index: slice) -> Frames: ...
    def __getitem__(self, index: int | slice) -> SurveyFrame | Unplaced | Frames:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        if index not in self.lost:
            try:
                return self._frames[index]
            except FrameError as error:
                self.lost[index] = Unplaced(error.name, str(error))
        return self.lost[index]
