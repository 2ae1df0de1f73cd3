"""All settings: a frozen model a stage; descriptions hold the reason for each default."""

from collections.abc import Iterator
from pathlib import Path
from typing import Literal

from pydantic import Field

from stereo_seecolor.config.color import ColorConfig, LampsConfig, PaperConfig, RobustConfig
from stereo_seecolor.config.inputs import InputConfig
from stereo_seecolor.config.mapping import MappingConfig, MarkersConfig, MountConfig
from stereo_seecolor.config.matching import MatchingConfig
from stereo_seecolor.config.output import OutputConfig
from stereo_seecolor.config.stage import StageConfig

__all__ = [
    "ColorConfig",
    "InputConfig",
    "LampsConfig",
    "MappingConfig",
    "MarkersConfig",
    "MatchingConfig",
    "MountConfig",
    "OutputConfig",
    "PaperConfig",
    "RobustConfig",
    "RunConfig",
]


class RunConfig(StageConfig):
    """The whole configuration of a run."""

    input: InputConfig = InputConfig()
    matching: MatchingConfig = MatchingConfig()
    color: ColorConfig = ColorConfig()
    mapping: MappingConfig = MappingConfig()
    output: OutputConfig = OutputConfig()
    device: Literal["auto", "cpu", "cuda"] = Field(
        default="auto",
        description="Device for matching with engine sgm, and for counting and correcting pixels; "
        "the water is fitted on the processor. auto: a GPU if there is one.",
    )

    @property
    def files(self) -> tuple[Path, ...]:
        """The files that the settings name."""
        return tuple(_paths(self))


def _paths(settings: StageConfig) -> Iterator[Path]:
    for _, value in settings:
        if isinstance(value, StageConfig):
            yield from _paths(value)
        elif isinstance(value, Path):
            yield value
