"""The settings of what is written."""

from typing import Literal

from pydantic import Field

from stereo_seecolor.config.stage import StageConfig


class OutputConfig(StageConfig):
    """What is written, and how."""

    image_format: Literal["png", "png16", "tiff32", "jpg"] = Field(
        default="png", description="Corrected images: png keeps the input's bit depth; tiff32 is linear and unclipped."
    )
    geometry: Literal["rectified", "original"] = Field(
        default="rectified",
        description="original: corrected images, ranges and masks also in the left camera's own pixels, named and sized as its "
        "images are, in OUT/original, for photogrammetry with a calibration of its own.",
    )
    preset: Literal["full", "lean"] = Field(
        default="full",
        description="lean: no clouds of single pairs, range maps deflated, their standard errors rounded to 0.2 %: "
        "a quarter of the disk.",
    )
    compression: Literal["fast", "small"] = Field(
        default="fast",
        description="small: pictures 5 to 8 % smaller and range maps deflated, for 130 ms a pair of 1.3 megapixels; "
        "no pixel differs.",
    )
    clouds: bool = Field(default=True, description="Write a colored cloud for each pair; preset lean writes none.")
    range_std: bool = Field(default=True, description="Write the standard error of each range beside the range maps.")

    @property
    def with_clouds(self) -> bool:
        """Whether clouds are written."""
        return self.clouds and self.preset == "full"

    @property
    def map_compression(self) -> Literal["fast", "small"] | None:
        """How range maps are deflated; None as they are."""
        return None if (self.preset, self.compression) == ("full", "fast") else self.compression
