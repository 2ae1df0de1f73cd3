"""How a job goes about its work, and who listens to it; nothing here changes what comes out."""

from dataclasses import dataclass, field
from typing import Protocol

from stereo_seecolor.run_folder.frames_table import FrameRow


class Listener(Protocol):
    """Who wants to know how far a survey is; see cli/."""

    def begin(self, stage: str, total: int) -> None:
        """A pass over ``total`` pairs begins."""

    def advance(self, row: FrameRow) -> None:
        """One more pair is through the pass."""


class Silence:
    """A listener that nobody hears."""

    def begin(self, stage: str, total: int) -> None:
        """Say nothing."""

    def advance(self, row: FrameRow) -> None:
        """Say nothing."""


@dataclass(frozen=True)
class RunOptions:
    """How a job goes about it, not what it makes.

    workers: pairs under way at once. overwrite: begin anew in a used folder. strict: stop at the first bad pair.
    """

    workers: int = 2
    overwrite: bool = False
    strict: bool = False
    listener: Listener = field(default_factory=Silence)
