"""All settings: a frozen model for each stage, with the reason for each default in its
description.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, model_validator

from stereo_seecolor.config.color import ColorConfig, PaperConfig, RobustConfig
from stereo_seecolor.config.mapping import MappingConfig, MarkersConfig, MountConfig
from stereo_seecolor.config.stage import (
    InputConfig,
    MatchingConfig,
    MeasuringConfig,
    OutputConfig,
    StageConfig,
)

__all__ = [
    "ColorConfig",
    "InputConfig",
    "MappingConfig",
    "MarkersConfig",
    "MatchingConfig",
    "MeasuringConfig",
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
    measuring: MeasuringConfig = MeasuringConfig()
    device: Literal["auto", "cpu", "cuda"] = Field(
        default="auto",
        description="Where engine sgm matches, and where pixels are counted and corrected; waters "
        "are fitted on the processor. auto: a GPU where there is one.",
    )

    @model_validator(mode="before")
    @classmethod
    def _without_fixed(cls, content: Any) -> Any:
        """A run.json of an earlier version also holds settings that are fixed now: those that hold
        the same value are left out.
        """
        if not isinstance(content, dict):
            return content
        return {
            section: {
                key: value for key, value in values.items() if not _is_fixed(section, key, value)
            }
            if isinstance(values, dict)
            else values
            for section, values in content.items()
        }

    @property
    def files(self) -> tuple[Path, ...]:
        """The files that settings name."""
        return tuple(_paths(self))


FIXED = {"color.input_noise": 0.006, "mapping.loop_closure": True, "output.clouds": True}
"""Settings of earlier versions -> what they are fixed at."""


def _is_fixed(section: object, key: object, value: object) -> bool:
    name = f"{section}.{key}"
    return name in FIXED and FIXED[name] == value


def _paths(settings: StageConfig) -> Iterator[Path]:
    for _, value in settings:
        if isinstance(value, StageConfig):
            yield from _paths(value)
        elif isinstance(value, Path):
            yield value
