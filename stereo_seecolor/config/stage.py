"""The base of the settings of every stage; and those of inputs, matching and output."""

from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, Strict, field_validator, model_validator

FilePath = Annotated[Path, Strict(False)]
"""A path, also given as text."""


class StageConfig(BaseModel):
    """Frozen settings, strictly checked: true, "1", infinity and NaN are not numbers, and unknown
    keys are refused.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


# The settings of what is written.


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


# The settings of the inputs: pairs, images, videos, the calibration.


class InputConfig(StageConfig):
    """How files are read and paired."""

    pairing: Literal["auto", "name", "timestamp"] = Field(
        "auto",
        description="Match left and right by name stem, by the time stamp in the name, or by "
        "name and else by time stamp.",
    )
    timestamp_tolerance_s: float = Field(
        0.01, ge=0, description="Largest difference between the two time stamps of a pair, seconds."
    )
    bayer: Literal["auto", "none", "rggb", "bggr", "gbrg", "grbg"] = Field(
        default="auto",
        description="Color filter pattern of single-channel raw images: the first two pixels "
        "of the first two rows. auto: recognized from pairs spread over the dive, assuming "
        "that red is darker than blue; for correct, and live with folders, auto means none.",
    )
    significant_bits: Literal["auto", None, 10, 12, 14] = Field(
        default="auto",
        description="Bits that 16-bit files use (12 for a 12-bit sensor stored unshifted); values "
        "are scaled to 16 bits. auto: the smallest number that fits the values of pairs "
        "spread over the dive; correct, and live with folders, use all 16. none: all 16.",
    )
    channels: Literal["rgb", "bgr"] = Field(
        default="rgb",
        description="bgr: the files store the channels in the order blue, green, red, like OpenCV "
        "arrays written by another library. A run names images that seem to be in this "
        "order.",
    )
    range_units_per_m: float | None = Field(
        default=None,
        gt=0,
        description="Units per meter in the range maps for correct and evaluate: 1000 for "
        "millimeters, 100 for centimeters, 5000 for TUM RGB-D, 256 for KITTI. Not set: 1 "
        "for floating-point numbers, 1000 for integers.",
    )
    right_half_first: bool = Field(
        default=False,
        description="For images and videos that show both sides: the left (or upper) half "
        "belongs to the right camera.",
    )
    exposures: FilePath | None = Field(
        default=None,
        description="CSV with exposure_s and gain of each image, by file name; missing values are "
        "read from EXIF.",
    )
    refine: bool = Field(
        default=False,
        description="Refine the calibration before the run, from pairs spread over the dive, "
        "in case the rig has moved. Used only if the rows of pairs left out of the estimate "
        "agree better.",
    )
    flat_port: str | None = Field(
        default=None,
        description="For cameras behind flat windows that were calibrated in air: the "
        "distance from lens to window and the thickness of the window, for example "
        "30mm:10mm; a third length is the distance at which ranges are exact (default 1.5m).",
    )
    video_step: float = Field(
        default=1.0,
        gt=0,
        description="Which frames of a video are used. A whole number n: every nth frame. A number "
        "below 1: the next frame that overlaps the last one used by less than this "
        "fraction (0.7 is good for maps).",
    )
    video_skip_blurred: bool = Field(
        default=False,
        description="Leave out video frames that are much less sharp than the frames around "
        "them, on either side.",
    )
    video_offset_s: float | None = Field(
        default=None,
        description="For two videos: seconds to add to the time of a left frame to get the time of "
        "the right frame. Not set: measured.",
    )

    @property
    def video_overlap(self) -> float | None:
        """The overlap that selects frames of a video; None if every nth frame is used."""
        return self.video_step if self.video_step < 1 else None

    @property
    def video_every(self) -> int:
        """The step between used frames of a video, unless the overlap selects them."""
        return max(1, int(self.video_step))

    @field_validator("video_step")
    @classmethod
    def _whole_or_below_1(cls, value: float) -> float:
        if value > 1 and not value.is_integer():
            raise ValueError("must be a whole number, or below 1")
        return value


# The settings of stereo matching.


class MatchingConfig(StageConfig):
    """Stereo matching: StereoFrame -> RangeMap."""

    min_range_m: float = Field(
        0.3,
        gt=0,
        description="Nearest range of the search, meters; sets the largest disparity.",
    )
    max_range_m: float = Field(
        default=20.0,
        gt=0,
        description="Farthest range kept, meters; must be more than the nearest.",
    )
    min_confidence: float = Field(
        default=0.8,
        ge=0,
        le=1,
        description="Pixels are unknown if the probability that their disparity is correct within "
        "one pixel is lower than this.",
    )
    fill: bool = Field(
        default=False,
        description="Fill holes with the ranges of neighbors; filled pixels are marked.",
    )
    engine: str | Path = Field(
        default="sgm",
        description="sgm: semi-global matching of the census. opencv: OpenCV's StereoSGBM, for "
        "comparison. An .onnx file: your own stereo network, run by onnxruntime (contract in "
        "docs/matching.md). Or one that another package adds (docs/extending.md).",
    )

    @field_validator("engine", mode="before")
    @classmethod
    def _known_engine(cls, engine: Any) -> Any:
        if engine == "sgbm":
            raise ValueError("is now called 'sgm'; 'opencv' is OpenCV's StereoSGBM")
        if engine == "onnx":
            raise ValueError("name the network's file itself: matching.engine=NET.onnx")
        return Path(engine) if str(engine).endswith(".onnx") else engine

    @model_validator(mode="after")
    def _near_before_far(self) -> Self:
        if self.max_range_m <= self.min_range_m:
            raise ValueError(
                f"max_range_m ({self.max_range_m:g}) must be more than min_range_m "
                f"({self.min_range_m:g})"
            )
        return self
