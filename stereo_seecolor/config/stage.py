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


# The settings of the inputs: pairs, images, videos, the calibration.


class InputConfig(StageConfig):
    """How files are read and paired."""

    pairing: Literal["auto", "name", "timestamp"] = Field(
        "auto",
        description="Match left and right by name stem, by the time stamp in the name, or by "
        "name and else by time stamp.",
    )
    timestamp_tolerance_s: float = Field(
        0.01, ge=0, description="Largest difference of the two time stamps of a pair, seconds."
    )
    bayer: Literal["auto", "none", "rggb", "bggr", "gbrg", "grbg"] = Field(
        default="auto",
        description="Color filter pattern of single-channel raw images, by the first two pixels of "
        "the first two rows. auto: recognized from pairs spread over the dive, assuming that red "
        "is darker than blue; correct, and live with folders, take auto as none.",
    )
    significant_bits: Literal["auto", None, 10, 12, 14] = Field(
        default="auto",
        description="Bits that 16-bit files really use (12 for a 12-bit sensor stored unshifted); "
        "scaled to full. auto: the fewest that hold the values of pairs spread over the dive; "
        "correct, and live with folders, take all 16. none: all 16.",
    )
    channels: Literal["rgb", "bgr"] = Field(
        default="rgb",
        description="bgr: the files hold blue in the place of red, as pictures of OpenCV that were "
        "written by another library do. A run names images that look like it.",
    )
    range_units_per_m: float | None = Field(
        default=None,
        gt=0,
        description="Of range maps given to correct and evaluate: how many of their units are a "
        "meter: 1000 for millimeters, 100 for centimeters, 5000 for TUM RGB-D, 256 for KITTI. Not "
        "set: 1 for floating point, 1000 for integers.",
    )
    right_half_first: bool = Field(
        default=False,
        description="Of images and videos that show both sides: the left (or upper) half is the "
        "right camera's.",
    )
    exposures: FilePath | None = Field(
        default=None,
        description="CSV with exposure_s and gain of each image, by its file name; values that "
        "it lacks are read from EXIF.",
    )
    refine: bool = Field(
        default=False,
        description="Estimate what has moved in the rig since its calibration from pairs spread "
        "over the dive, before the run. "
        "Used only where rows of pairs left out of the estimate agree better.",
    )
    flat_port: str | None = Field(
        default=None,
        description="For cameras that were calibrated in air and look through flat windows under "
        "water: the distance from lens to window and the thickness of the window, such as "
        "30mm:10mm; a third length is the range at which ranges are exact (1.5m).",
    )
    video_step: float = Field(
        default=1.0,
        gt=0,
        description="Of a video, which frames are taken. A whole number n: every nth. A number "
        "below 1: a frame as soon as it shows less than this fraction of the last one taken (0.7 "
        "suits maps).",
    )
    video_skip_blurred: bool = Field(
        default=False,
        description="Of a video, leave out frames that are much less sharp than those around "
        "them, on either side.",
    )
    video_offset_s: float | None = Field(
        default=None,
        description="Of two videos, the time to add to that of a left frame to get that of the "
        "right one, seconds. Not set: measured.",
    )

    @property
    def video_overlap(self) -> float | None:
        """The overlap by which frames of a video are taken; None where every nth is."""
        return self.video_step if self.video_step < 1 else None

    @property
    def video_every(self) -> int:
        """Every how many frames of a video one is taken, where not by overlap."""
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
        description="Nearest range looked for, meters; sets the largest disparity searched.",
    )
    max_range_m: float = Field(
        default=20.0, gt=0, description="Farthest range kept, meters; more than the nearest."
    )
    min_confidence: float = Field(
        default=0.8,
        ge=0,
        le=1,
        description="Pixels whose disparity is right to within one pixel with a lower "
        "probability than this are left unknown.",
    )
    fill: bool = Field(
        default=False,
        description="Close the holes with what their neighbors suggest; such pixels are marked.",
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
