"""The settings of what is written."""

from typing import Literal

from pydantic import Field

from stereo_seecolor.config.stage import StageConfig


class OutputConfig(StageConfig):
    """Files that are written, and their formats."""

    image_format: Literal["png", "png16", "tiff32", "jpg"] = Field(
        default="png",
        description="Corrected images: png keeps the input's bit depth; tiff32 is linear and "
        "unclipped.",
    )
    geometry: Literal["rectified", "original"] = Field(
        default="rectified",
        description="original: corrected images, ranges and masks also in the pixels of the "
        "raw left camera, with the names and sizes of its images, in OUT/original, for "
        "photogrammetry programs with their own calibration.",
    )
    preset: Literal["full", "no-clouds", "lean"] = Field(
        default="full",
        description="full: with a colored cloud for each pair. no-clouds: without. lean: without, "
        "range maps compressed more, standard errors rounded to 0.2 %: a quarter of the "
        "disk space.",
    )

    @property
    def with_clouds(self) -> bool:
        """Whether clouds are written."""
        return self.preset == "full"

    @property
    def deflated_maps(self) -> bool:
        """Whether range maps are deflated."""
        return self.preset == "lean"
