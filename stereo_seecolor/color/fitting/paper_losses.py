"""The constants of the paper's losses, shared by their implementations."""

from typing import NamedTuple


class PaperLosses(NamedTuple):
    """A tuple, since compiled code cannot read a dataclass."""

    clamp_deviations: float = 5.0
    """The direct signal is clamped to so many standard deviations about its mean before the attenuation fit (theory.md, row 5)."""
    target: float = 0.5
    """Mean of a channel of the corrected image in the intensity loss, fraction of full scale (theory.md, row 6)."""


PAPER = PaperLosses()
