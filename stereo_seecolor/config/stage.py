"""The base of the settings of every stage."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, Strict

FilePath = Annotated[Path, Strict(False)]
"""A path, also given as text."""


class StageConfig(BaseModel):
    """Frozen settings, strictly checked: true, "1", infinity and NaN are no numbers, and unknown
    keys are refused.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


# The settings of lengths measured in a frame.


class MeasuringConfig(StageConfig):
    """What is known of the rig when lengths are measured."""

    length_error: float | None = Field(
        default=None,
        ge=0,
        lt=1,
        description="Standard error of a length that comes from the calibration, as a fraction; a "
        "bar of known length shows it. "
        "Not set: what the calibration itself states, or else 0.005.",
    )


# The settings of what is written.


class OutputConfig(StageConfig):
    """What is written, and how."""

    image_format: Literal["png", "png16", "tiff32", "jpg"] = Field(
        default="png",
        description="Corrected images: png keeps the input's bit depth; tiff32 is linear and "
        "unclipped.",
    )
    geometry: Literal["rectified", "original"] = Field(
        default="rectified",
        description="original: corrected images, ranges and masks also in the left camera's own "
        "pixels, named and sized as its "
        "images are, in OUT/original, for photogrammetry with a calibration of its own.",
    )
    preset: Literal["full", "no-clouds", "lean"] = Field(
        default="full",
        description="full: with a colored cloud for each pair. no-clouds: without. lean: without, "
        "range maps deflated, their standard errors rounded to 0.2 %: a quarter of the disk.",
    )

    @property
    def with_clouds(self) -> bool:
        """Whether clouds are written."""
        return self.preset == "full"

    @property
    def deflated_maps(self) -> bool:
        """Whether range maps are deflated."""
        return self.preset == "lean"
